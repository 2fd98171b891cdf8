"""A sprite: the cut-out pictures of one thing, ready to be drawn at any place, size and angle."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from entrack.datasets.frames import Image
from entrack.errors import EntrackError

LEVELS = 4  # each half the size of the one before: small drawings do not flicker


@dataclass(frozen=True)
class Sprite:
    """Pictures of one thing in motion, played as a film (one picture if it is rigid).

    Parameters
    ----------
    pictures
        For each of N pictures its levels of detail, (h, w, 4) uint8: BGR multiplied by alpha, then
        alpha, with the thing's shadow in it.
    shapes
        The same for the thing's own alpha, without its shadow: (h, w) uint8.
    hulls
        For each picture the convex hull (K, 2) of its shape (alpha ≥ .5), in pixels from the
        picture's centre: whatever turns and stretches the sprite, the hull's extent is its box.
    """

    pictures: tuple[tuple[Image, ...], ...]
    shapes: tuple[tuple[Image, ...], ...]
    hulls: tuple[NDArray[np.float64], ...]

    def __len__(self) -> int:
        return len(self.pictures)

    @property
    def size(self) -> float:
        """√(width × height) of the first picture's shape, in pixels."""
        w, h = np.ptp(self.hulls[0], axis=0).tolist()
        return float(np.sqrt(w * h))

    def tinted(self, gains: NDArray[np.float64]) -> "Sprite":
        """The same thing in slightly other colours: B, G and R multiplied by `gains` (3,)."""
        factors = np.append(gains, 1.0)
        dyed = tuple(
            tuple(np.clip(np.round(level * factors), 0, 255).astype(np.uint8) for level in levels)
            for levels in self.pictures
        )
        return replace(self, pictures=dyed)

    @property
    def mirrored(self) -> "Sprite":
        """The same thing, left and right exchanged."""
        pictures, shapes = (
            tuple(tuple(np.ascontiguousarray(level[:, ::-1]) for level in p) for p in film)
            for film in (self.pictures, self.shapes)
        )
        return Sprite(pictures, shapes, tuple(points * (-1, 1) for points in self.hulls))

    def level(self, scale: float) -> int:
        """The level of detail to draw at `scale`."""
        return int(np.clip(np.floor(np.log2(1 / max(scale, 1e-6)) + 0.3), 0, LEVELS - 1))


def sprite(
    pictures: NDArray[np.uint8],
    shadow: float = 0.35,
    towards: tuple[float, float] = (0.025, 0.05),
) -> Sprite:
    """Make a sprite of straight BGRA pictures (N, h, w, 4) or of one (h, w, 4).

    A soft `shadow` (0 none, 1 black) falls `towards` the right and down, in shares of the size.

    Raises
    ------
    EntrackError
        Unless the pictures are BGRA uint8 and each shows something.
    """
    stack = np.asarray(pictures)
    stack = stack[None] if stack.ndim == 3 else stack
    if stack.ndim != 4 or stack.shape[-1] != 4 or stack.dtype != np.uint8:
        found = f"{stack.shape} {stack.dtype}"
        raise EntrackError(f"a sprite is made of BGRA pictures (N, h, w, 4) uint8, found {found}")
    if (stack[..., 3].max(axis=(1, 2)) < 128).any():
        raise EntrackError("a sprite needs something to see in every picture, found an empty one")
    h, w = stack.shape[1:3]
    fall = min(h, w) * np.array(towards)
    margin = int(np.ceil(3 * np.abs(fall).max())) if shadow else 2
    step = 2 ** (LEVELS - 1)
    below, right = margin + -(h + 2 * margin) % step, margin + -(w + 2 * margin) % step
    edges = margin, below, margin, right
    padded = [_padded(picture, edges) for picture in stack]
    shapes = [np.ascontiguousarray(picture[..., 3]) for picture in padded]
    return Sprite(
        tuple(_levels(_with_shadow(picture, shadow, fall)) for picture in padded),
        tuple(_levels(shape) for shape in shapes),
        tuple(hull(shape) for shape in shapes),
    )


def hull(shape: Image) -> NDArray[np.float64]:
    """Convex hull (K, 2) of alpha ≥ .5 to a part of a pixel, in pixels from the picture's centre.

    Its corners lie where alpha, interpolated between neighbouring pixels, passes one half.
    """
    alpha = shape.astype(np.float64) / 255
    centres = np.array(shape.shape[::-1]) / 2 - 0.5
    points: list[NDArray[np.float64]] = []
    for field, flip in ((alpha, 1), (alpha.T, -1)):
        a, b = field[:, :-1], field[:, 1:]
        row, column = np.nonzero((a >= 0.5) != (b >= 0.5))
        a, b = a[row, column], b[row, column]
        crossing = column + (0.5 - a) / (b - a)
        points.append(np.stack([crossing, row.astype(float)], axis=1)[:, ::flip])
    edge = np.concatenate(points).astype(np.float32)
    return cv2.convexHull(edge)[:, 0].astype(np.float64) - centres


def deforming(rng: Generator, picture: Image, amount: float, count: int = 32) -> NDArray[np.uint8]:
    """A film (count, h, w, 4) in which one straight BGRA picture bends and swells, and loops.

    `amount` is the deviation of the bending, as a share of the picture's size.
    """
    spread = amount * max(picture.shape)
    most = 2 * spread
    grow = int(np.ceil(1.5 * most))
    padded = _padded(picture, (grow, grow, grow, grow))
    h, w = padded.shape[:2]
    # Two still bends turned into each other by cosine and sine: a loop without a seam.
    bends = np.empty((2, 2, h, w), np.float32)
    for bend in bends.reshape(4, h, w):
        field = np.clip(spread * rng.standard_normal((4, 4)), -most, most)
        bend[:] = cv2.resize(field.astype(np.float32), (w, h), interpolation=cv2.INTER_CUBIC)
    x, y = np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32))
    film = np.empty((count, h, w, 4), np.uint8)
    for picture, phase in zip(film, np.arange(count) * (2 * np.pi / count), strict=True):
        dx, dy = np.float32(np.cos(phase)) * bends[0] + np.float32(np.sin(phase)) * bends[1]
        cv2.remap(padded, x + dx, y + dy, cv2.INTER_LINEAR, picture, cv2.BORDER_REPLICATE)
    return film


def _padded(picture: Image, edges: tuple[int, int, int, int]) -> Image:
    """Room at the top, the bottom, the left and the right, empty."""
    return cv2.copyMakeBorder(picture, *edges, cv2.BORDER_CONSTANT)  # pyright: ignore


def _with_shadow(picture: Image, shadow: float, fall: NDArray[np.float64]) -> Image:
    """Multiply BGR by alpha and lay the shadow under it."""
    alpha = picture[..., 3:].astype(np.float32) / 255
    colour = picture[..., :3] * alpha
    if shadow:
        move = np.array([[1, 0, fall[0]], [0, 1, fall[1]]], np.float32)
        cast = cv2.warpAffine(alpha, move, alpha.shape[1::-1])
        cast = shadow * cv2.GaussianBlur(cast, (0, 0), 0.6 * np.abs(fall).max())[..., None]
        alpha = alpha + (1 - alpha) * cast
    return np.round(np.dstack([colour, 255 * alpha])).astype(np.uint8)


def _levels(picture: Image) -> tuple[Image, ...]:
    """Halve a picture again and again by averaging squares of four."""
    levels = [np.ascontiguousarray(picture)]
    for _ in range(LEVELS - 1):
        h, w = levels[-1].shape[:2]
        levels.append(cv2.resize(levels[-1], (w // 2, h // 2), interpolation=cv2.INTER_AREA))  # pyright: ignore
    return tuple(levels)
