"""Odometries of other libraries as odometries of ours: `pip install roadscope[peers]`."""
