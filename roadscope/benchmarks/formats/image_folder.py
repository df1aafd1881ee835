"""Folders of images, one file each: PNG or JPEG."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.formats.scan_stamps import (
    OrderedScans,
    Stamps,
    in_order,
    stamps_of_files,
    without_ending,
)
from roadscope.benchmarks.formats.table import FormatError, visible
from roadscope.benchmarks.formats.tracking_rows import ImageSize

if TYPE_CHECKING:
    from PIL.Image import Image

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg")
IMAGE_FOLDERS = ("image_2", "image_02/data", "image_02")
"""Where KITTI has the images of its left colour camera."""
SCANS = "velodyne"
"""KITTI's folder of scans; images are beside it."""


@dataclass(frozen=True, slots=True)
class ImageFolder:
    """Files of images in order.

    losses: the errors of images that could not be read so far.
    """

    ordered: OrderedScans
    losses: dict[Path, FormatError] = field(default_factory=dict, compare=False)

    @staticmethod
    def find(folder: Path | str) -> ImageFolder | None:
        """Return the images of a folder; None without any.

        They are in it or in one of `IMAGE_FOLDERS` in it. Those of KITTI's scans are beside these.
        """
        root = Path(folder).absolute()
        within = [root, *(root / name for name in IMAGE_FOLDERS)]
        if root.name == SCANS:
            within += [root.parent / name for name in IMAGE_FOLDERS]
        if root.parent.name == SCANS:
            within += [root.parent.parent / name / root.name for name in IMAGE_FOLDERS]
        found = ([path for path in visible(each) if _is_image(path)] for each in within)
        files = next((each for each in found if each), None)
        return None if files is None else ImageFolder(in_order(files, IMAGE_ENDINGS))

    def __len__(self) -> int:
        return len(self.files)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files in order."""
        return self.ordered.files

    @property
    def names(self) -> list[str]:
        """The names of the images, without ending."""
        return [without_ending(path.name, IMAGE_ENDINGS) for path in self.files]

    def stamps(self, rate_hz: float) -> Stamps:
        """Return the stamps of the images; rate_hz: a second, if nothing says when they are of."""
        return stamps_of_files(self.ordered, rate_hz)[0]

    def size(self, row: int | None = None) -> ImageSize | None:
        """Return the size of an image, or of the first that can be opened; None if it cannot be."""
        for path in self.files if row is None else self.files[row : row + 1]:
            with suppress(FormatError), _opened(path) as image:
                return ImageSize(*image.size)
        return None

    def read(self, row: int) -> np.ndarray | None:
        """Return (H, W, 3) uint8 pixels, RGB; None, and an error in `losses`, if it is damaged."""
        try:
            return read_image(self.files[row])
        except FormatError as error:
            self.losses[self.files[row]] = error
            return None


def read_image(path: Path) -> np.ndarray:
    """Return (H, W, 3) uint8 pixels, RGB, turned upright as the file says."""
    with _opened(path) as image:
        if image.mode[0] in "IF":
            raise FormatError(f"{path}: expected 8 bits a colour, got mode {image.mode}")
        return np.array(image.convert("RGB"))


@contextmanager
def _opened(path: Path) -> Iterator[Image]:
    """Open an image, turned upright; errors until it is closed become `FormatError`."""
    from PIL import Image, ImageOps

    try:
        with warnings.catch_warnings():
            # Of an image so large that it may be an attack.
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                ImageOps.exif_transpose(image, in_place=True)
                yield image
    except FormatError:
        raise
    except (OSError, ValueError, SyntaxError, Warning, Image.DecompressionBombError) as error:
        raise FormatError(f"{path}: expected an image, PNG or JPEG: {error}") from error


def _is_image(path: Path) -> bool:
    return path.suffix.lower() in IMAGE_ENDINGS
