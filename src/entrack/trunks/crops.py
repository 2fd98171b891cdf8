"""Square crops of many pictures at random places and scales, for distillation."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from entrack.datasets.frames import ImageFiles
from entrack.errors import EntrackError

Image = NDArray[np.uint8]


def load_stills(folder: Path) -> list[Image]:
    """Read every picture of a folder into memory: BGR uint8 (H, W, 3)."""
    paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in {".jpg", ".jpeg", ".png"})
    if not paths:
        raise EntrackError(f"no .jpg or .png pictures in {folder}")
    return list(ImageFiles(paths))


def load_clips(paths: Iterable[Path], every: int) -> list[Image]:
    """Keep every `every`-th frame of some videos in memory."""
    import av

    frames: list[Image] = []
    for path in paths:
        with av.open(str(path)) as clip:
            for i, frame in enumerate(clip.decode(video=0)):
                if i % every == 0:
                    frames.append(cast(Image, frame.to_ndarray(format="bgr24")))
    return frames


def grey(image: Image) -> Image:
    """Take the colour out of a picture; it keeps its three channels."""
    return cast(Image, cv2.merge([cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)] * 3))


def photometric(image: Image, rng: np.random.Generator) -> Image:
    """Change brightness, contrast, tint, sharpness and noise a little, as cameras do."""
    x = image.astype(np.float32)
    gain = rng.uniform(0.7, 1.3) * rng.uniform(0.93, 1.07, 3)
    x = (x - 128) * gain.astype(np.float32) + 128 + rng.uniform(-25, 25)
    if rng.random() < 0.2:
        x = cv2.GaussianBlur(x, (0, 0), rng.uniform(0.5, 2.0))
    if rng.random() < 0.2:
        x = x + rng.normal(0, rng.uniform(2, 8), x.shape).astype(np.float32)
    return np.clip(x, 0, 255).astype(np.uint8)


def random_crop(image: Image, size: int, rng: np.random.Generator) -> Image:
    """Cut a square of random scale, place and reflection, at `size` × `size` pixels."""
    height, width = int(image.shape[0]), int(image.shape[1])
    side = math.exp(rng.uniform(math.log(32), math.log(min(height, width))))
    x, y = rng.uniform(0, width - side), rng.uniform(0, height - side)
    scale = size / side
    matrix = np.array([[scale, 0, -x * scale], [0, scale, -y * scale]])
    if rng.random() < 0.5:
        matrix[0] = [-scale, 0, (x + side) * scale]
    method = cv2.INTER_AREA if scale < 0.5 else cv2.INTER_LINEAR
    border = cv2.BORDER_REPLICATE
    return cast(Image, cv2.warpAffine(image, matrix, (size, size), flags=method, borderMode=border))


def batch(pictures: Sequence[Image], count: int, size: int, rng: np.random.Generator) -> Image:
    """Random crops (count, size, size, 3), BGR uint8."""
    chosen: list[int] = rng.integers(len(pictures), size=count).tolist()
    crops = [photometric(random_crop(pictures[i], size, rng), rng) for i in chosen]
    return np.stack([grey(c) if rng.random() < 0.1 else c for c in crops])
