"""The search window: where the tracker looks, as a patch of fixed size (first half of g, eq. 4)."""

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack.box import Boxes, centre
from entrack.config import WindowConfig
from entrack.errors import EntrackError

Image = NDArray[np.uint8]
LONGEST = 32766
"""Pixels a side of the largest frame: OpenCV counts them in 16 bits."""


@dataclass(frozen=True)
class Window:
    """A rectangle of the image, `(x, y, w, h)` in continuous pixels, seen as a square patch."""

    x: float
    y: float
    w: float
    h: float
    size: int
    """Side of the patch, pixels."""

    @property
    def box(self) -> Boxes:
        """The window as a box (4,)."""
        return np.array([self.x, self.y, self.w, self.h])

    def to_patch(self, boxes: ArrayLike) -> Boxes:
        """Boxes of the image in the patch's pixels."""
        b = np.asarray(boxes, np.float64)
        return (b - [self.x, self.y, 0, 0]) * (self.size / np.tile([self.w, self.h], 2))

    def to_image(self, boxes: ArrayLike) -> Boxes:
        """Boxes of the patch in the image's pixels."""
        b = np.asarray(boxes, np.float64)
        return b * (np.tile([self.w, self.h], 2) / self.size) + [self.x, self.y, 0, 0]


def around(box: ArrayLike, config: WindowConfig, zoom: float = 1.0) -> Window:
    """Lay the search window around `box`; `zoom` > 1 looks at more of the image.

    >>> around([100, 100, 40, 90], WindowConfig())
    Window(x=30.0, y=55.0, w=180.0, h=180.0, size=288)
    """
    b = np.asarray(box, np.float64)
    (cx, cy), (w, h) = centre(b).tolist(), b[2:].tolist()
    if config.shape == "square":
        w = h = float(np.sqrt(w * h))
    w, h = w * config.context * zoom, h * config.context * zoom
    return Window(cx - w / 2, cy - h / 2, w, h, config.size)


def crop(image: Image, window: Window, border: str = "replicate") -> Image:
    """Cut the window out of an image (H, W, 3) → patch (size, size, 3), uint8 BGR.

    Sampling is bilinear and exact to a fraction of a pixel; strongly shrunk windows are averaged
    first, so that nothing aliases. Outside the image lie its edge pixels or its mean colour.
    """
    sx, sy = window.w / window.size, window.h / window.size
    x, y = window.x, window.y
    if min(sx, sy) >= 3:
        # Average whole blocks of the part in view: at most 1.5 pixels a sample remain.
        image, x, y, step = _shrink(image, window, int(min(sx, sy) / 1.5))
        sx, sy, x, y = sx / step, sy / step, x / step, y / step
    # Pixel i covers [i, i + 1): its centre, which warpAffine counts from, lies at i + ½.
    matrix = np.array([[sx, 0, x + sx / 2 - 0.5], [0, sy, y + sy / 2 - 0.5]])
    mode = cv2.BORDER_REPLICATE if border == "replicate" else cv2.BORDER_CONSTANT
    fill = cv2.mean(image) if border == "mean" else (0, 0, 0)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (window.size, window.size)
    patch = cv2.warpAffine(image, matrix, size, flags=flags, borderMode=mode, borderValue=fill)
    return cast(Image, patch)


def _shrink(image: Image, window: Window, step: int) -> tuple[Image, float, float, int]:
    """Average blocks of `step` × `step` pixels of the part of the image that the window sees.

    Returns the small picture, the window's left top corner from the part's, and `step`.
    """
    height, width = image.shape[:2]

    def part(start: float, length: float, end: int) -> tuple[int, int]:
        first = int(np.clip(start // step * step, 0, end - 1))
        last = int(np.clip(start + length + step, first + 1, end))
        return first, last - (last - first) % step if last - first >= step else last

    (x0, x1), (y0, y1) = part(window.x, window.w, width), part(window.y, window.h, height)
    size = (max(1, (x1 - x0) // step), max(1, (y1 - y0) // step))
    small = cv2.resize(image[y0:y1, x0:x1], size, interpolation=cv2.INTER_AREA)
    return cast(Image, small), window.x - x0, window.y - y0, step


def as_bgr(image: Any) -> Image:
    """Bring a picture to BGR uint8 (H, W, 3): grey, RGBA, 16 bit and floats in [0, 1] are accepted.

    Raises
    ------
    EntrackError
        For anything that is not a picture.
    """
    try:
        a = np.asarray(image)
    except (TypeError, ValueError, RuntimeError) as error:
        raise EntrackError(f"a frame is an array, found {type(image).__name__}") from error
    if a.ndim == 2:
        a = a[:, :, None]
    if a.ndim != 3 or a.shape[2] not in (1, 3, 4):
        raise EntrackError(f"a frame is an array (H, W), (H, W, 3) or (H, W, 4), found {a.shape}")
    if not (2 <= min(a.shape[:2]) and max(a.shape[:2]) <= LONGEST):
        height, width = a.shape[:2]
        raise EntrackError(f"a frame has 2 to {LONGEST} pixels a side, found {width}×{height}")
    if a.dtype == np.uint16:
        a = (a >> 8).astype(np.uint8)
    elif np.issubdtype(a.dtype, np.floating):
        a = (np.clip(np.nan_to_num(a), 0, 1) * 255).round().astype(np.uint8)
    elif a.dtype == np.bool_:
        a = a.astype(np.uint8) * 255
    elif a.dtype != np.uint8:
        raise EntrackError(f"a frame holds uint8, uint16 or floats in [0, 1], found {a.dtype}")
    if a.shape[2] == 1:
        a = np.repeat(a, 3, axis=2)
    return np.ascontiguousarray(a[:, :, :3])
