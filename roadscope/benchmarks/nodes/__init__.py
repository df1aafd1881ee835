"""What is computed and kept in a run: traffic, detections, images, fusions, poses, tracks."""
