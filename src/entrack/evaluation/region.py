"""Overlap of rotated boxes as the VOT toolkits measure it: in pixels, scan line by scan line.

Both toolkits round the corners and fill inclusive scan lines, and disagree in details that shift
the third digit. `overlaps` follows region.c (VOT's first toolkit, pysot) or vot-toolkit ≥ 0.5.
Nothing is painted: a row of a quadrilateral is at most two spans, all rows of a video at once.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
_CORNERS = 4


@dataclass(frozen=True)
class Regions:
    """A region for each frame of a video.

    Parameters
    ----------
    corners
        (T, 8) float64 `x1, y1, … x4, y4`; NaN rows where there is no region.
    upright
        (T,) bool: the region was given as `x, y, w, h`, which vot-toolkit fills differently.
    """

    corners: Floats
    upright: NDArray[np.bool_]

    @classmethod
    def of(cls, numbers: ArrayLike) -> Self:
        """Regions of boxes (T, 4) or corners (T, 8).

        >>> Regions.of([[0, 0, 2, 1]]).corners
        array([[0., 0., 2., 0., 2., 1., 0., 1.]])
        """
        n = np.asarray(numbers, np.float64)
        if n.shape[1] == 2 * _CORNERS:
            return cls(n, np.zeros(len(n), bool))
        x, y, w, h = n.T
        corners = np.stack([x, y, x + w, y, x + w, y + h, x, y + h], axis=1)
        return cls(corners, np.ones(len(n), bool))

    def __len__(self) -> int:
        return len(self.corners)

    def __getitem__(self, frames: slice) -> "Regions":
        return Regions(self.corners[frames], self.upright[frames])


def overlaps(
    a: Regions, b: Regions, size: tuple[int, int] | None = None, *, toolkit: bool = False
) -> Floats:
    """Overlap (T,) of two regions a frame, in [0, 1]; NaN where one of them is missing.

    Parameters
    ----------
    size
        Width and height of the picture to which the regions are bounded; None: unbounded.
    toolkit
        Count as vot-toolkit ≥ 0.5 does instead of as region.c.

    >>> square, half = Regions.of([[0, 0, 9, 9]]), Regions.of([[0, 0, 9, 4]])
    >>> overlaps(square, half), overlaps(square, half, toolkit=True)
    (array([0.5]), array([0.444]))
    """
    result = np.full(len(a), np.nan)
    known = np.flatnonzero(np.isfinite(a.corners).all(axis=1) & np.isfinite(b.corners).all(axis=1))
    if len(known):
        frame = _toolkit_frame if toolkit else _region_c_frame
        result[known] = frame(_pick(a, known), _pick(b, known), size)
    return result


def _pick(regions: Regions, frames: NDArray[np.intp]) -> Regions:
    return Regions(regions.corners[frames], regions.upright[frames])


def _region_c_frame(a: Regions, b: Regions, size: tuple[int, int] | None) -> Floats:
    """Overlap by the rules of region.c, which computes in single precision."""
    pa, pb = (r.corners.astype(np.float32).reshape(-1, _CORNERS, 2) for r in (a, b))
    limit = np.array([np.inf, np.inf] if size is None else size, np.float32)
    low = np.float32(-np.inf if size is None else 0)
    (la, ha), (lb, hb) = (
        (np.maximum(np.floor(p.min(axis=1)), low), np.minimum(np.ceil(p.max(axis=1)), limit))
        for p in (pa, pb)
    )
    origin = np.minimum(la, lb)
    extent = np.trunc(np.maximum(ha, hb) - origin).astype(np.int64) + 1
    area_a, area_b = (ha - la).prod(axis=1), (hb - lb).prod(axis=1)
    shared = (np.minimum(ha, hb) - np.maximum(la, lb)).prod(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        apart = shared / (area_a + area_b - shared) <= 0
        apart |= (area_a / area_b < 1e-10) | (area_b / area_a < 1e-10) | (extent < 1).any(axis=1)
    extent[apart] = 1
    rows = _Rows(extent)
    spans = [rows.spans(_round_away(p - origin[:, None]), flat_edges=False) for p in (pa, pb)]
    return np.where(apart, 0.0, rows.overlap(*spans))


def _toolkit_frame(a: Regions, b: Regions, size: tuple[int, int] | None) -> Floats:
    """Overlap by the rules of vot-toolkit's `calculate_overlap`."""
    pa, pb = (_toolkit_corners(r) for r in (a, b))
    (la, ha), (lb, hb) = _toolkit_extent(pa, a.upright), _toolkit_extent(pb, b.upright)
    low, high = np.minimum(la, lb), np.maximum(ha, hb)
    empty = (low >= high).any(axis=1)
    if size is not None:
        low, high = np.maximum(low, 0), np.minimum(high, np.array(size) - 1)
    outside = (low >= high).any(axis=1)
    extent = (high - low).astype(np.int64) + 1
    extent[outside] = 1
    rows = _Rows(extent)
    spans: list[tuple[Floats, Floats]] = []
    for points, upright in ((pa, a.upright), (pb, b.upright)):
        first, last = rows.spans(points - low[:, None], flat_edges=True)
        # A box is cut at the window's last column counted in the picture: the toolkit's own slip.
        box = rows.box_spans(points[:, 0] - low, np.minimum(points[:, 2] - low, high))
        chosen = upright[rows.frame][:, None]
        spans.append((np.where(chosen, box[0], first), np.where(chosen, box[1], last)))
    return np.where(empty, 1.0, np.where(outside, 0.0, rows.overlap(*spans)))


def _toolkit_corners(regions: Regions) -> Floats:
    """Rounded corners (T, 4, 2); a box ends on its last pixel, not on the edge after it."""
    points = regions.corners.astype(np.float32).reshape(-1, _CORNERS, 2)
    size = np.round(points[:, 2] - points[:, 0])
    points = np.round(points)
    points[regions.upright, 1:] = (points[:, 0] + size - 1)[regions.upright, None]
    return points.astype(np.float64)


def _toolkit_extent(points: Floats, upright: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """First and last pixel (T, 2); a box thinner than half a pixel ends before it begins."""
    box = upright[:, None]
    low, high = points.min(axis=1), points.max(axis=1)
    return np.where(box, points[:, 0], low), np.where(box, points[:, 2], high)


def _round_away(x: NDArray[np.float32]) -> Floats:
    """C's `round`: halves go away from zero."""
    return np.copysign(np.floor(np.abs(x) + np.float32(0.5)), x).astype(np.float64)


class _Rows:
    """Every pixel row of every frame's window, one after the other."""

    def __init__(self, extent: NDArray[np.int64]) -> None:
        width, height = extent.T
        self.frames = len(extent)
        self.frame = np.repeat(np.arange(self.frames), height)
        self.y = np.arange(len(self.frame)) - np.repeat(np.cumsum(height) - height, height)
        self.last = width[self.frame] - 1

    def spans(self, corners: Floats, *, flat_edges: bool) -> tuple[Floats, Floats]:
        """Filled spans of each row: first and last pixel (R, 2); first > last where there is none.

        `flat_edges` adds a horizontal edge's first corner to the crossings.
        """
        x, y = corners[self.frame, :, 0], corners[self.frame, :, 1]  # (R, 4) each
        x0, y0 = np.roll(x, 1, axis=1), np.roll(y, 1, axis=1)
        row = self.y[:, None]
        flat = y == y0
        crossed = (np.minimum(y, y0) <= row) & (row <= np.maximum(y, y0)) & (~flat | flat_edges)
        with np.errstate(invalid="ignore", divide="ignore"):
            at = np.where(flat, x, np.trunc(x + (row - y) / (y0 - y) * (x0 - x)))
        nodes = np.sort(np.where(crossed, at, np.inf), axis=1)
        return self._pair(nodes, crossed.sum(axis=1), keep_last=flat_edges)

    def box_spans(self, first: Floats, last: Floats) -> tuple[Floats, Floats]:
        """Spans of boxes from their first to their last pixel (T, 2), in the form of `spans`."""
        (x0, y0), (x1, y1) = (c[self.frame].T for c in (first, last))
        inside = (y0 <= self.y) & (self.y <= y1)
        none = np.zeros(len(self.y))
        ends = np.where(inside, np.minimum(x1, self.last), -1)
        return np.stack([np.maximum(x0, 0), none + 1], axis=1), np.stack([ends, none], axis=1)

    def _pair(
        self, nodes: Floats, count: NDArray[np.int64], *, keep_last: bool
    ) -> tuple[Floats, Floats]:
        """Join crossings (R, 4) two by two; of two equal ones the first is passed over.

        `keep_last`: but not if they are the row's last two.
        """
        first, last = np.ones((len(nodes), 2)), np.zeros((len(nodes), 2))
        at, found = _zeros(len(nodes)), _zeros(len(nodes))
        for _ in range(_CORNERS - 1):
            here = np.minimum(at, _CORNERS - 2)[:, None]
            left = np.take_along_axis(nodes, here, axis=1)[:, 0]
            right = np.take_along_axis(nodes, here + 1, axis=1)[:, 0]
            active = at < count - 1
            skipped = active & (left == right)
            if keep_last:
                skipped &= at < count - 2
            filled = np.flatnonzero(active & ~skipped)
            first[filled, found[filled]] = np.maximum(left[filled], 0)
            last[filled, found[filled]] = np.minimum(right[filled], self.last[filled])
            found[filled] += 1
            at[:] += 2 - skipped
        first[:, 1] = np.maximum(first[:, 1], np.where(found == 2, last[:, 0] + 1, 1))
        return first, last

    def overlap(self, a: tuple[Floats, Floats], b: tuple[Floats, Floats]) -> Floats:
        """Intersection over union (T,) of two sets of spans."""
        shared = np.zeros(len(self.y))
        for i in range(2):
            for j in range(2):
                shared += _length(
                    np.maximum(a[0][:, i], b[0][:, j]), np.minimum(a[1][:, i], b[1][:, j])
                )
        union = _length(*a).sum(axis=1) + _length(*b).sum(axis=1) - shared
        shared, union = (np.bincount(self.frame, n, self.frames) for n in (shared, union))
        return shared / np.maximum(union, 1)


def _zeros(count: int) -> NDArray[np.int64]:
    return np.zeros(count, np.int64)


def _length(first: Floats, last: Floats) -> Floats:
    return np.maximum(last - first + 1, 0)
