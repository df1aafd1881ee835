"""LeGO-LOAM's steps: range image, ground, two-step match, map of keyframes, loops."""
