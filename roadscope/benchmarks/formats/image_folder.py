"""Folders of images, one file each: PNG or JPEG."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from roadscope.benchmarks.formats.bags import (
    IMAGES,
    NS,
    Bag,
    BagMessage,
    Source,
    image_pixels,
    open_bag,
)
from roadscope.benchmarks.formats.scan_stamps import (
    OrderedScans,
    Stamps,
    in_order,
    recorded_stamps,
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
    """Files of images in order; in a bag, messages stand for files.

    losses: the errors of images that could not be read so far.
    """

    files: tuple[Source, ...]
    ordered: OrderedScans | None = None
    losses: dict[Source, FormatError] = field(default_factory=dict, compare=False)

    @staticmethod
    def find(
        folder: Path | str, topics: Sequence[str] = (), *, bag: Bag | None = None
    ) -> ImageFolder | None:
        """Return the images of a folder or of a bag; None without any.

        They are in it or in one of `IMAGE_FOLDERS` in it. Those of KITTI's scans are beside these.
        bag: that of the folder, if it is open already.
        """
        root = Path(folder).absolute()
        within = [root, *(root / name for name in IMAGE_FOLDERS)]
        if root.name == SCANS:
            within += [root.parent / name for name in IMAGE_FOLDERS]
        if root.parent.name == SCANS:
            within += [root.parent.parent / name / root.name for name in IMAGE_FOLDERS]
        files_by_folder = ([path for path in visible(each) if _is_image(path)] for each in within)
        files = next((each for each in files_by_folder if each), None)
        if files is not None:
            ordered = in_order(files, IMAGE_ENDINGS)
            return ImageFolder(ordered.files, ordered)
        bag = bag or open_bag(Path(folder))
        topic = None if bag is None else bag.topic(IMAGES, topics)
        if bag is None or topic is None:
            return None
        return ImageFolder(bag.messages(topic).messages)

    def __len__(self) -> int:
        return len(self.files)

    @property
    def place(self) -> Path | None:
        """The folder with the images; None for a bag."""
        first = self.files[0]
        return None if isinstance(first, BagMessage) else first.parent

    @property
    def names(self) -> list[str]:
        """The names of the images, without ending."""
        return [without_ending(path.name, IMAGE_ENDINGS) for path in self.files]

    def stamps(self, rate_hz: float) -> Stamps:
        """Return the stamps of the images; rate_hz: a second, if nothing says when they are of."""
        if self.ordered is not None:
            return stamps_of_files(self.ordered, rate_hz)[0]
        messages = [each for each in self.files if isinstance(each, BagMessage)]
        stamps_s = np.array([each.stamp_ns * NS for each in messages])
        return recorded_stamps(stamps_s, self.names)

    def size(self, row: int | None = None) -> ImageSize | None:
        """Return the size of an image, or of the first that can be opened; None if it cannot be."""
        for path in self.files if row is None else self.files[row : row + 1]:
            with suppress(FormatError):
                if isinstance(path, BagMessage):
                    return ImageSize(*read_image(path).shape[1::-1])
                with _opened(path, path) as image:
                    return ImageSize(*image.size)
        return None

    def read(self, row: int) -> np.ndarray | None:
        """Return (H, W, 3) uint8 pixels, RGB; None, and an error in `losses`, if it is damaged."""
        try:
            return read_image(self.files[row])
        except FormatError as error:
            self.losses[self.files[row]] = error
            return None


def read_image(source: Source) -> np.ndarray:
    """Return (H, W, 3) uint8 pixels, RGB, turned upright as the file says."""
    content: Path | BytesIO
    if isinstance(source, BagMessage):
        message = source.read()
        if hasattr(message, "encoding"):
            return image_pixels(message, str(source))
        content = BytesIO(bytes(message.data))
    else:
        content = source
    with _opened(content, source) as image:
        if image.mode[0] in "IF":
            raise FormatError(f"{source}: expected 8 bits a colour, got mode {image.mode}")
        return np.array(image.convert("RGB"))


@contextmanager
def _opened(content: Path | BytesIO, source: Source) -> Iterator[Image]:
    """Open an image, turned upright; errors until it is closed become `FormatError`."""
    from PIL import Image, ImageOps

    try:
        with warnings.catch_warnings():
            # Of an image so large that it may be an attack.
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(content) as image:
                ImageOps.exif_transpose(image, in_place=True)
                yield image
    except FormatError:
        raise
    except (OSError, ValueError, SyntaxError, Warning, Image.DecompressionBombError) as error:
        raise FormatError(f"{source}: expected an image, PNG or JPEG: {error}") from error


def _is_image(path: Path) -> bool:
    return path.suffix.lower() in IMAGE_ENDINGS
