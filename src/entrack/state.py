"""The state s_t: what the policy sees of a frame, eqs. 4–6.

z = f1(Z) stands for the target's appearance, m = f2(M) for its response, and s = (z, m). There are
two f1: the paper's 1×1 convolution, and a network that compares Z with the target as it was in the
first frame. Both are plain numpy; `entrack.learn.networks` has the same in torch, to learn.
"""

from collections.abc import Mapping
from functools import cache
from typing import NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entrack.window import Window

Array = NDArray[np.float32]
Weights = Mapping[str, Array]

GRID = 8
"""Points a side at which the first frame's features are kept for comparison …"""
GROWN = 8 / 6
"""… spread over the box, grown by so much: the outermost ring lies in the background."""


class State(NamedTuple):
    """s = (z, m), eq. 6."""

    z: Array
    """(C, n, n): f1(Z), eq. 4; flattened in the paper, where C is 1."""
    m: Array
    """f2(M), flattened, eq. 5."""
    held: Array
    """The last box (4,), see `held`: a square window, unlike the paper's, does not show its shape,
    and no window shows how far its size is from the first."""

    @property
    def vector(self) -> Array:
        """S as one vector: z, then m, then what the window does not say."""
        return np.concatenate([self.z.ravel(), self.m, self.held])


def held(box: ArrayLike, first: ArrayLike, window: ArrayLike) -> Array:
    """What the policy is told of the last box (4,).

    Width and height in shares of the window's side, and the logarithms of both in units of the
    first box's: what is not seen clearly is more likely to have kept its size.

    >>> held([0, 0, 45, 90], [0, 0, 45, 90], [0, 0, 180, 180]).tolist()
    [0.25, 0.5, 0.0, 0.0]
    """
    size, first_size = np.asarray(box, np.float64)[2:], np.asarray(first, np.float64)[2:]
    shares = size / np.asarray(window, np.float64)[2:]
    return np.concatenate([shares, np.log(size / first_size)]).astype(np.float32)


class F1(Protocol):
    """Makes z of Z."""

    def remember(self, features: Array, roi: Array) -> object:
        """What f1 has to know of the first frame: Z (C, n, n) with the target at `roi`."""
        ...

    def __call__(self, features: Array, response: Array, held: Array, target: object) -> Array:
        """Z (C, n, n) → z (C', n, n), eq. 4."""
        ...


class Linear:
    """The paper's f1: a 1×1 convolution of 256 channels to one."""

    def __init__(self, weights: Weights) -> None:
        self.weight, self.bias = weights["f1.weight"], weights["f1.bias"]

    def remember(self, features: Array, roi: Array) -> None:
        """Nothing: it does not know the target."""

    def __call__(self, features: Array, response: Array, held: Array, target: object) -> Array:
        """See `F1`."""
        return np.tensordot(self.weight, features, 1) + self.bias[:, None, None]


def f2(response: Array, side: int) -> Array:
    """M = f2(M), eq. 5: M (n, n) at `side` × `side`, flattened.

    With 72, M is enlarged to 288 × 288 and averaged over 4 × 4 (§3.2.8). Both are linear, so one
    matrix a side does it (row 7); the peak of a target that has not moved comes to the centre.
    """
    if side == response.shape[-1]:
        return response.ravel()
    resize = _resize(response.shape[-1], side)
    return cast(Array, resize @ response @ resize.T).ravel()


@cache
def _resize(n: int, side: int, fine: int = 4) -> Array:
    """Circular linear interpolation to `fine` · `side` points, then means of `fine`: (side, n)."""
    count = side * fine
    place = (np.arange(count) + 0.5) * n / count  # cell n / 2 comes to the middle of the picture
    low = np.floor(place).astype(int)
    share = place - low
    matrix = np.zeros((count, n))
    np.add.at(matrix, (np.arange(count), low % n), 1 - share)
    np.add.at(matrix, (np.arange(count), (low + 1) % n), share)
    return matrix.reshape(side, fine, n).mean(axis=1).astype(np.float32)


def sample_grid(features: Array, roi: Array, points: int = GRID, grown: float = GROWN) -> Array:
    """Features (C, n, n) at `points` × `points` places over `roi`, by bilinear interpolation.

    `roi` (4,) is a box in shares of the patch's side; it is grown about its centre first.
    """
    n = features.shape[-1]
    along = (np.arange(points) + 0.5) / points - 0.5
    columns = _interpolate((roi[0] + roi[2] / 2 + along * roi[2] * grown) * n - 0.5, n)
    rows = _interpolate((roi[1] + roi[3] / 2 + along * roi[3] * grown) * n - 0.5, n)
    return cast(Array, rows @ features @ columns.T)


def sample_box(features: Array, box: ArrayLike, window: Window, points: int) -> Array:
    """Features (C, points, points) of a window at places spread over `box`."""
    roi = (window.to_patch(box) / window.size).astype(np.float32)
    return sample_grid(features, roi, points, grown=1)


def sample_boxes(features: Array, boxes: ArrayLike, window: Window, points: int) -> Array:
    """The same of several boxes (k, 4), channels last: (k, points · points, C)."""
    n = features.shape[-1]
    x, y, w, h = (window.to_patch(boxes) * (n / window.size)).T[..., None]
    along = (np.arange(points) + 0.5) / points
    columns, rows = _interpolate(x + w * along - 0.5, n), _interpolate(y + h * along - 0.5, n)
    # Small products, of the cells that any box needs alone: no BLAS wakes its threads for them.
    above, left = (np.flatnonzero(weights.any(axis=(0, 1))) for weights in (rows, columns))
    down, across = slice(above[0], above[-1] + 1), slice(left[0], left[-1] + 1)
    cells = np.ascontiguousarray(features[:, down, across].transpose(1, 2, 0))
    seen = np.matmul(columns[:, None, :, across], cells)  # (k, rows, points, C)
    seen = np.matmul(rows[:, None, :, down], seen.swapaxes(1, 2)).swapaxes(1, 2)
    return cast(Array, seen.reshape(-1, points * points, len(features)))


def shifted(features: Array, seen: Window, wanted: Window) -> Array:
    """Features (C, n, n) of the window `seen`, resampled to what `wanted` would have shown."""
    return sample_box(features, wanted.box, seen, features.shape[-1])


def _interpolate(places: NDArray[np.float64], n: int) -> Array:
    """Weights (…, n) of the two cells around each place."""
    away = np.abs(np.clip(places, 0, n - 1)[..., None] - np.arange(n))
    return np.maximum(1 - away, 0).astype(np.float32)


class Conditioned:
    """An f1 that knows the target: Z is compared with what lay in the first frame's box.

    Every cell of Z is matched with 8 × 8 points of the first box by cosine, which says where the
    target's parts are now and so where its sides are; with the mean of the box, which says what
    belongs to it; and is looked at for itself. A few convolutions make z of that, of M, of the
    place in the window, and of the last box's shape.
    """

    def __init__(self, weights: Weights) -> None:
        self.w = {name.removeprefix("f1."): w for name, w in weights.items() if "f1." in name}
        self.layers = sum(name.endswith(".weight") and "convs" in name for name in self.w)

    def remember(self, features: Array, roi: Array) -> tuple[Array, Array]:
        """See `F1`: unit vectors of the box's points (d, 64), and a gate (e,) from its mean."""
        points = sample_grid(features, roi)
        keys = unit(_project(points, self.w["match.weight"], self.w["match.bias"]))
        mean = points[:, 1:-1, 1:-1].mean(axis=(1, 2))
        return keys, self.w["gate.weight"] @ mean + self.w["gate.bias"]

    def __call__(self, features: Array, response: Array, held: Array, target: object) -> Array:
        """See `F1`."""
        keys, gate = cast(tuple[Array, Array], target)
        n = features.shape[-1]
        matched = unit(_project(features, self.w["match.weight"], self.w["match.bias"]))
        belongs = _project(features, self.w["belong.weight"], self.w["belong.bias"])
        itself = _project(features, self.w["itself.weight"], self.w["itself.bias"])
        seen = [4 * keys.T @ matched, _relu(belongs) * gate[:, None], itself]
        x = np.concatenate([*seen, context(response, held)])
        x = _relu(self.w["mix.weight"] @ x + self.w["mix.bias"][:, None])
        for k in range(self.layers):
            weight, bias = self.w[f"convs.{k}.weight"], self.w[f"convs.{k}.bias"]
            x = x + _relu(_convolve(x.reshape(-1, n, n), weight, bias))
        return x.reshape(-1, n, n)


def context(response: Array, held: Array) -> Array:
    """Eight planes (8, n · n) of what is known besides Z: M, M with its peak at 1, and `place`."""
    n = response.shape[-1]
    peak = max(float(response.max()), 0.05)
    planes = np.stack([2 * response, response / peak]).reshape(2, n * n)
    return np.concatenate([planes, place(n, held)])


def place(n: int, held: Array) -> Array:
    """Six planes (6, n · n) of what does not depend on the picture.

    x and y from the centre, the distance squared, the last box, and how much wider and higher it is
    than the first.
    """
    along = ((np.arange(n, dtype=np.float32) + 0.5) / n - 0.5).astype(np.float32)
    x, y = np.broadcast_to(along, (n, n)), np.broadcast_to(along[:, None], (n, n))
    inside = _soft(held[0] / 2 - np.abs(x)) * _soft(held[1] / 2 - np.abs(y))
    planes = [2 * x, 2 * y, 4 * (x * x + y * y), inside, *np.tile(held[2:, None, None], (1, n, n))]
    return np.stack(planes).reshape(6, n * n).astype(np.float32)


def _soft(distance: Array) -> Array:
    """A step of about a cell's width: 0 outside, 1 inside."""
    return cast(Array, 1 / (1 + np.exp(-40 * distance)))


def _relu(x: Array) -> Array:
    return np.maximum(x, 0)


def unit(x: Array, axis: int = 0) -> Array:
    """The same at length 1 along an axis."""
    length = np.sqrt((x * x).sum(axis=axis, keepdims=True))
    return x / np.maximum(length, np.float32(1e-12))


def _project(features: Array, weight: Array, bias: Array) -> Array:
    """A 1×1 convolution of (C, …) → (d, cells)."""
    return weight @ features.reshape(len(features), -1) + bias[:, None]


def _convolve(x: Array, weight: Array, bias: Array) -> Array:
    """A 3×3 convolution with zero padding of (C, n, n) by (D, 9 · C) → (D, n · n)."""
    c, n, _ = x.shape
    padded = np.zeros((c, n + 2, n + 2), np.float32)
    padded[:, 1:-1, 1:-1] = x
    shifted = [padded[:, i : i + n, j : j + n] for i in range(3) for j in range(3)]
    columns = np.concatenate([s.reshape(c, n * n) for s in shifted])
    return weight @ columns + bias[:, None]
