"""Overlap in pixels against scan lines painted one by one."""

import math

import numpy as np
import pytest

from entrack.evaluation.region import Regions, overlaps


def paint(corners, width, height, *, toolkit):
    """Fill a polygon as the toolkits describe it: crossings of a row, sorted, joined in pairs."""
    mask = np.zeros((height, width), bool)
    points = [tuple(map(float, p)) for p in corners]
    for row in range(height):
        nodes = []
        for (x, y), (x0, y0) in zip(points, points[-1:] + points[:-1], strict=True):
            if not min(y, y0) <= row <= max(y, y0):
                continue
            if y != y0:
                nodes.append(int(x + (row - y) / (y0 - y) * (x0 - x)))
            elif toolkit:
                nodes.append(int(x))
        nodes.sort()
        i = 0
        while i < len(nodes) - 1:
            if nodes[i] == nodes[i + 1] and not (toolkit and i >= len(nodes) - 2):
                i += 1
                continue
            mask[row, max(nodes[i], 0) : max(min(nodes[i + 1], width - 1) + 1, 0)] = True
            i += 2
    return mask


def slow_region_c(a, b, size):
    """region.c: single precision, halves rounded away from zero, windows of whole pixels."""
    a, b = (np.array(p, np.float32).reshape(4, 2) for p in (a, b))
    limits = (-np.inf, np.inf, np.inf) if size is None else (0, *size)

    def bounds(p):
        low = np.maximum(np.floor(p.min(axis=0)), limits[0])
        return low, np.minimum(np.ceil(p.max(axis=0)), limits[1:])

    (la, ha), (lb, hb) = bounds(a), bounds(b)
    shared = (np.minimum(ha, hb) - np.maximum(la, lb)).prod()
    areas = (ha - la).prod(), (hb - lb).prod()
    if shared / (sum(areas) - shared) <= 0 or min(areas) <= 0:
        return 0.0
    low = np.minimum(la, lb)
    width, height = (int(n) + 1 for n in np.maximum(ha, hb) - low)
    if width < 1 or height < 1:
        return 0.0

    def rounded(p):
        return [[math.copysign(math.floor(abs(v) + 0.5), v) for v in point] for point in (p - low)]

    ma, mb = (paint(rounded(p), width, height, toolkit=False) for p in (a, b))
    return (ma & mb).sum() / max((ma | mb).sum(), 1)


@pytest.fixture
def quadrilaterals():
    random = np.random.default_rng(1)
    centres = random.uniform(-10, 60, (300, 1, 2))
    angles = np.sort(random.uniform(0, 7, (300, 4, 1)), axis=1)
    radii = random.uniform(1, 30, (300, 4, 1))
    corners = centres + radii * np.concatenate([np.cos(angles), np.sin(angles)], axis=2)
    corners[::3] = corners[::3].round()  # level edges and shared corners
    corners[::5] = corners[::5].round() + 0.5  # halves to round
    return corners[:150].reshape(-1, 8), corners[150:].reshape(-1, 8)


@pytest.mark.parametrize("size", [None, (50, 40)])
def test_overlap_equals_painted_scan_lines(quadrilaterals, size):
    a, b = quadrilaterals
    expected = [slow_region_c(x, y, size) for x, y in zip(a, b, strict=True)]
    assert np.mean(np.array(expected) > 0) > 0.05
    np.testing.assert_allclose(overlaps(Regions.of(a), Regions.of(b), size), expected, atol=1e-12)


def test_toolkit_overlap_equals_painted_scan_lines(quadrilaterals):
    a, b = (np.round(c.astype(np.float32)) for c in quadrilaterals)
    expected = []
    for x, y in zip(a.reshape(-1, 4, 2), b.reshape(-1, 4, 2), strict=True):
        low = np.maximum(np.minimum(x.min(axis=0), y.min(axis=0)), 0)
        high = np.minimum(np.maximum(x.max(axis=0), y.max(axis=0)), (49, 39))
        if (low >= high).any():
            expected.append(0.0)
            continue
        width, height = (int(n) + 1 for n in high - low)
        ma, mb = (paint(p - low, width, height, toolkit=True) for p in (x, y))
        expected.append((ma & mb).sum() / max((ma | mb).sum(), 1))
    result = overlaps(Regions.of(a), Regions.of(b), (50, 40), toolkit=True)
    np.testing.assert_allclose(result, expected, atol=1e-12)


def test_boxes_are_filled_to_the_edge_by_one_toolkit_and_to_the_last_pixel_by_the_other():
    ten, five = Regions.of([[0, 0, 10, 10]]), Regions.of([[0, 0, 10, 5]])
    assert overlaps(ten, five)[0] == pytest.approx(11 * 6 / (11 * 11))
    assert overlaps(ten, five, toolkit=True)[0] == pytest.approx(0.5)


def test_a_frame_without_a_region_has_no_overlap():
    gone = Regions.of([[np.nan] * 8])
    assert np.isnan(overlaps(gone, Regions.of([[0, 0, 5, 5]])))[0]


def test_many_overlaps_are_fast_enough(quadrilaterals):
    import time

    a, b = (Regions.of(np.tile(c * 4, (10, 1))) for c in quadrilaterals)
    started = time.process_time()
    overlaps(a, b, (640, 480))
    assert time.process_time() - started < 3  # .3 s on an idle machine
