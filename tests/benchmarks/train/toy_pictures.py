"""Pictures in which red slabs are cars and thin blue ones people."""

import numpy as np

from roadscope.benchmarks.metrics import Labels
from roadscope.benchmarks.train import Pictures, PixelSize

SIZE = PixelSize(480, 640)


def toy_pictures(seed: int, count: int = 4, size: PixelSize = SIZE) -> Pictures:
    rng = np.random.default_rng(seed)
    pixels, labels = [], []
    for _ in range(count):
        image = np.full((*size, 3), 110, np.uint8)
        boxes, categories = [], []
        for place in range(6):
            person = bool(rng.random() < 0.5)
            width, height = (14, 44) if person else (70, 40)
            left = 20 + place * 100 + int(rng.integers(0, 20))
            top = int(rng.integers(120, size.height - 120))
            image[top : top + height, left : left + width] = (
                (20, 20, 220) if person else (220, 20, 20)
            )
            boxes.append((left, top, left + width, top + height))
            categories.append(6 if person else 0)
        n = len(boxes)
        pixels.append(image)
        labels.append(
            Labels(
                np.array(boxes),
                np.array(categories),
                np.full(n, 500),
                np.zeros(n),
                np.full(n, 20.0),
            )
        )
    return Pictures(np.stack(pixels), tuple(labels))
