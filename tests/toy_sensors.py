"""A suite of seconds with camera and LiDAR."""

from roadscope.fusion import FUSIONS

TINY = """
name = "tiny"
version = 1
rig = "wide"
duration_s = 1.2
scenarios = ["street"]
faults = ["clear", "blackout:5"]
split = "validation"
seeds = [10001, 10009]
[eligibility]
range_m = [0.0, 60.0]
min_returns = 5
families = ["vehicle", "cyclist", "pedestrian"]
[tracking]
entries = ["nearest"]
detectors = ["fused?lidar=cluster-boxes&camera=noisy-camera&fusion=consistent"]
[camera]
entries = ["network", "colour-blobs", "noisy-camera"]
every_s = 0.4
[fusion]
entries = [ENTRIES]
lidar = ["cluster-boxes", "distance-l-shape"]
camera = ["noisy-camera", "colour-blobs"]
every_s = 0.4
""".replace("ENTRIES", ", ".join(f'"{name}"' for name in FUSIONS.names()))
