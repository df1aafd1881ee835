"""The nodes of a run: traffic, detections, image detections, fusions, poses and tracks."""
