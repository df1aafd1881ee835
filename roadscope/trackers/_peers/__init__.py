"""Trackers of other libraries as trackers of ours: `pip install roadscope[peers]`."""
