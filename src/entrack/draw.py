"""Overlays for videos and filmstrips for papers: what the tracker says, drawn on the picture."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack import box as boxes_
from entrack.datasets.frames import Image
from entrack.tracker import Estimate

Colour = tuple[int, int, int]

PALETTE: tuple[Colour, ...] = (
    (0, 159, 230),
    (233, 180, 86),
    (66, 228, 240),
    (115, 158, 0),
    (167, 121, 204),
    (0, 94, 213),
    (178, 114, 0),
)
"""Okabe and Ito's colours (BGR), which colour-blind people tell apart, too."""
_DARK, _WHITE = (28, 28, 28), (255, 255, 255)
_FONT = cv2.FONT_HERSHEY_DUPLEX
_SHIFT = 4  # OpenCV draws between pixels, in sixteenths


def overlay(
    image: Image,
    estimates: Sequence[Estimate | None],
    frame: int | None = None,
    fps: float | None = None,
    size: tuple[int, int] | None = None,
) -> Image:
    """Draw what the tracker says of one frame on a copy of the picture.

    Each object has its colour and, where there are several, its number. The tag of a box holds the
    score as a number and as a bar. The band around its sides reaches one standard deviation to
    either side, if the model knows it. Brackets show the search window. A lost object's box is
    dashed, and its tag says so.

    Parameters
    ----------
    image
        (H, W, 3) uint8 BGR.
    frame, fps
        Written into a corner: the frame's number and the frames a second.
    size
        (width, height) of the copy, if it is to be another; the boxes are scaled with it.
    """
    height, width = image.shape[:2]
    if size in (None, (width, height)):
        canvas, scale = image.copy(), None
    else:
        canvas = cast(Image, cv2.resize(image, size, interpolation=cv2.INTER_AREA))
        scale = np.tile([size[0] / width, size[1] / height], 2)
    width = _line_width(canvas)
    for number, estimate in enumerate(estimates):
        if estimate is None:  # an object that is not there yet
            continue
        if scale is not None:
            estimate = _scaled(estimate, scale)
        colour = PALETTE[number % len(PALETTE)]
        if estimate.sigma is not None:
            _band(canvas, estimate.box, estimate.sigma, colour)
        _stroke(canvas, _brackets(estimate.search), colour, width // 2)
        sides = _dashes(estimate.box, 4 * width) if estimate.lost else [_outline(estimate.box)]
        _stroke(canvas, sides, colour, width)
        words = [f"{number + 1}:"] * (len(estimates) > 1) + ["LOST"] * estimate.lost
        _tag(
            canvas,
            estimate.box,
            " ".join([*words, f"{estimate.score:.2f}"]),
            colour,
            estimate.score,
        )
    status = [f"frame {frame}"] * (frame is not None) + [f"{fps or 0:.0f} frames/s"] * (
        fps is not None
    )
    if status:
        _caption(canvas, "   ".join(status))
    return canvas


def _scaled(estimate: Estimate, scale: NDArray[np.float64]) -> Estimate:
    sigma = None if estimate.sigma is None else estimate.sigma * scale
    return replace(estimate, box=estimate.box * scale, search=estimate.search * scale, sigma=sigma)


def filmstrip(
    images: Sequence[Image],
    boxes: ArrayLike,
    truth: ArrayLike | None = None,
    labels: Sequence[str] | None = None,
    columns: int | None = None,
    width: int = 1600,
) -> Image:
    """Set frames side by side, in rows, with the tracker's box in orange and the truth in white.

    Parameters
    ----------
    images
        N pictures (H, W, 3) uint8 BGR.
    boxes, truth
        (N, 4) in the pixels of the pictures; a row with NaN is not drawn.
    labels
        N words for the corners of the frames.
    columns
        Frames in a row; by default all up to four, more than that in rows of equal length.
    width
        Of the result in pixels, whose height follows from the first picture's shape.
    """
    columns = columns or -(-len(images) // -(-len(images) // 4))
    gap = 6
    cell_w = (width - gap * (columns - 1)) // columns
    cell_h = round(cell_w * images[0].shape[0] / images[0].shape[1])
    rows = -(-len(images) // columns)
    strip = np.full((rows * (cell_h + gap) - gap, columns * (cell_w + gap) - gap, 3), 255, np.uint8)
    for i, image in enumerate(images):
        cell = cast(Image, cv2.resize(image, (cell_w, cell_h), interpolation=cv2.INTER_AREA))
        scale = np.tile([cell_w / image.shape[1], cell_h / image.shape[0]], 2)
        for rows_of, colour in ((truth, _WHITE), (boxes, PALETTE[0])):
            box = None if rows_of is None else np.asarray(rows_of, np.float64)[i] * scale
            if box is not None and np.isfinite(box).all():
                _stroke(cell, [_outline(box)], colour, max(1, cell_w // 400))
        if labels is not None:
            _caption(cell, labels[i])
        top, left = i // columns * (cell_h + gap), i % columns * (cell_w + gap)
        strip[top : top + cell_h, left : left + cell_w] = cell
    return strip


def _line_width(image: Image) -> int:
    """2 pixels on 720p, 6 on 4K."""
    return max(2, round(float(np.hypot(*image.shape[:2])) / 700))


def _text_height(image: Image) -> int:
    return max(9, round(min(image.shape[:2]) / 48))


Path = NDArray[np.float64]
"""Corners (K, 2) of an open line."""


def _stroke(canvas: Image, paths: Sequence[Path], colour: Colour, width: int) -> None:
    """Draw lines with a dark rim, so that they are seen on any ground."""
    # The centre of OpenCV's pixel 0 is at 0, ours at ½.
    points = [np.round((path - 0.5) * 2**_SHIFT).astype(np.int32) for path in paths]
    for ink, thickness in ((_DARK, width + max(1, width // 2)), (colour, width)):
        cv2.polylines(canvas, points, False, ink, thickness, cv2.LINE_AA, _SHIFT)


def _outline(box: ArrayLike) -> Path:
    x0, y0, x1, y1 = boxes_.to_corners(box)
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])


def _dashes(box: ArrayLike, dash: float) -> list[Path]:
    """The outline in dashes of about `dash` pixels, with dashes in its corners."""
    paths: list[Path] = []
    for start, end in itertools.pairwise(_outline(box)):
        pieces = 2 * max(1, round(float(np.linalg.norm(end - start)) / dash / 2)) + 1
        stops = start + (end - start) * np.linspace(0, 1, pieces + 1)[:, None]
        paths += [stops[k : k + 2] for k in range(0, pieces, 2)]
    return paths


def _brackets(box: ArrayLike) -> list[Path]:
    """The four corners of a box, a tenth of its sides long."""
    corners = _outline(box)[:4]
    arms = [np.roll(corners, shift, axis=0) - corners for shift in (1, -1)]
    return [
        np.array([corner + a / 10, corner, corner + b / 10])
        for corner, a, b in zip(corners, *arms, strict=True)
    ]


def _band(canvas: Image, box: ArrayLike, sigma: ArrayLike, colour: Colour) -> None:
    """Tint the frame between the box's sides less and plus their standard deviations."""
    out = np.asarray(sigma, np.float64) * [-1, -1, 1, 1]
    corners = boxes_.to_corners(box)
    limits = np.tile([canvas.shape[1], canvas.shape[0]], 2)
    x0, y0, x1, y1 = np.clip(np.round(corners + out), 0, limits).astype(int)
    u0, v0, u1, v1 = np.clip(np.round(corners - out), 0, limits).astype(int)
    inside = canvas[v0:v1, u0:u1].copy()
    _tint(canvas[y0:y1, x0:x1], colour, 0.4)
    canvas[v0 : v0 + inside.shape[0], u0 : u0 + inside.shape[1]] = inside


def _tint(area: Image, colour: Colour, share: float) -> None:
    area[:] = np.round(area * (1 - share) + np.multiply(colour, share)).astype(np.uint8)


def _tag(canvas: Image, box: ArrayLike, text: str, colour: Colour, score: float) -> None:
    """A label over the box, or under it at the picture's upper edge, with the score's bar."""
    height = _text_height(canvas)
    pad, bar = height // 2, max(2, height // 4)
    w, h = _text_width(text, height) + 2 * pad, height + 2 * pad + bar
    x0, y0, _, y1 = boxes_.to_corners(box)
    gap = _line_width(canvas)
    top = y0 - h - gap if y0 - h - gap >= 0 else y1 + gap
    x = int(np.clip(x0, 0, max(0, canvas.shape[1] - w)))
    y = int(np.clip(top, 0, max(0, canvas.shape[0] - h)))
    bright = np.dot(colour, (0.114, 0.587, 0.299)) > 120
    cv2.rectangle(canvas, (x, y), (x + w - 1, y + h - 1), colour, cv2.FILLED)
    _text(canvas, text, (x + pad, y + pad + height), height, _DARK if bright else _WHITE)
    y += h - bar
    cv2.rectangle(canvas, (x, y), (x + w - 1, y + bar - 1), _DARK, cv2.FILLED)
    full = round(score * w)
    if full > 0:
        cv2.rectangle(canvas, (x, y), (x + full - 1, y + bar - 1), _WHITE, cv2.FILLED)


def _caption(canvas: Image, text: str) -> None:
    """White words on a dark strip in the lower left corner."""
    height = _text_height(canvas)
    pad = round(height * 0.6)
    area = canvas[-(height + 2 * pad) :, : _text_width(text, height) + 2 * pad]
    _tint(area, _DARK, 0.65)
    _text(canvas, text, (pad, canvas.shape[0] - pad), height, _WHITE)


def _text_width(text: str, height: int) -> int:
    return cv2.getTextSize(text, _FONT, height / _CAP, 1)[0][0]


def _text(canvas: Image, text: str, at: tuple[int, int], height: int, colour: Colour) -> None:
    cv2.putText(canvas, text, at, _FONT, height / _CAP, colour, 1, cv2.LINE_AA)


_CAP = 22  # height of the font's capitals at scale 1, pixels
