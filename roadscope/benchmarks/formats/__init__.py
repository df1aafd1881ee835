"""Files that others write and read: KITTI tracking, MOTChallenge."""

from roadscope.benchmarks.formats.kitti import KittiSequence, read_sequence
from roadscope.benchmarks.formats.kitti_folder import KittiFolder
from roadscope.benchmarks.formats.table import FormatError

__all__ = ["FormatError", "KittiFolder", "KittiSequence", "read_sequence"]
