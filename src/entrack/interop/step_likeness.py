"""Likeness, aspect and the sampling of features in torch, for `entrack export`: see `step`."""
# pyright: basic

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from entrack import aspect as aspects
from entrack.interop.step_filter import Filtering
from entrack.likeness import (
    ALONG,
    AROUND_FINER,
    CLOSEST,
    FINER,
    FURTHEST,
    HEAT,
    SCATTERED,
    SHARP,
    WIDER,
    WITHIN,
)
from entrack.state import GRID, GROWN


class Known(NamedTuple):
    """What is remembered of the first frame, and of what the box has looked like since."""

    first: Tensor
    """Z of the first frame's window, …"""
    first_fine: Tensor
    """… the finer map of it, …"""
    roi: Tensor
    """… and the box in it, in shares of its side."""
    inside: Tensor
    """`Likeness.coarse`, …"""
    inside_fine: Tensor
    """… and `fine`."""


class Matching(Filtering):
    """`likeness`, `aspect` and `state.sample_grid`, for one target."""

    def fit(
        self, z: Tensor, fine: Tensor, held: Tensor, known: Known, offset: Tensor
    ) -> tuple[Tensor, Tensor]:
        """`likeness.Likeness.fit`: how far the box has moved (2,), and its growth (1,)."""
        config, size = self.config.likeness, held[:2]
        assert config

        def alike(x: float, y: float, factor: float, finer: bool = True) -> Tensor:
            corner = 0.5 + offset + size * torch.tensor([x, y]) - size * factor / 2
            roi = torch.cat([corner, size * factor])
            inside = known.inside_fine if finer else known.inside
            if finer:
                seen = self.beyond(fine, known.first_fine, roi, FINER)
            else:
                seen = self.beyond(z, known.first, roi)
            return (seen * inside).sum() / (seen.norm() * inside.norm()).clamp_min(1e-9)

        box = torch.cat([0.5 + offset, size])
        move = config.share * self.off(fine, known.first_fine, known.roi, box, AROUND_FINER)
        offset, s = offset - size * move.clamp(-FURTHEST, FURTHEST), config.step
        grown = alike(0, 0, config.span) - alike(0, 0, 1 / config.span)
        grown += alike(0, 0, config.span, False) - alike(0, 0, 1 / config.span, False)
        slope = torch.stack([alike(s, 0, 1) - alike(-s, 0, 1), alike(0, s, 1) - alike(0, -s, 1)])
        offset = offset + size * (config.pull * slope).clamp(-FURTHEST, FURTHEST)
        most = math.log(config.span)
        return offset, (config.gain * grown + config.bias).clamp(-most, most).exp()[None]

    def off(self, z: Tensor, first: Tensor, roi: Tensor, box: Tensor, side: int) -> Tensor:
        """`likeness.FirstLook.off` (2,): of a box by its centre and size, in shares of the window.

        `first` is the first frame's map, in which the box was `roi`.
        """
        assert self.config.likeness
        step, middle, sides = self.config.likeness.step, roi[:2] + roi[2:] / 2, roi[2:]

        def points(z: Tensor, centre: Tensor, size: Tensor) -> Tensor:
            wider = torch.cat([centre - WIDER * size / 2, WIDER * size])
            return self.sample_grid(z, wider, side, 1.0).flatten()

        moved = torch.cat([torch.eye(4), -torch.eye(4), torch.zeros(1, 4)]) * step
        near = [points(first, middle + m[:2] * sides, sides * m[2:].exp()) for m in moved]
        change = (torch.stack(near[:4]) - torch.stack(near[4:8])) / (2 * step)
        seen = points(z, box[:2], box[2:]) - near[8]
        return solve(change @ change.T, change @ seen)[:2]

    def beyond(self, z: Tensor, first: Tensor, roi: Tensor, points: int = GRID) -> Tensor:
        """What the points of a box have beyond the first window's mean: (C, points, points)."""
        return self.sample_grid(z, roi, points, 1.0) - first.mean((1, 2), keepdim=True)

    def looks_wider(self, z: Tensor, first: Tensor, roi: Tensor, place: Tensor) -> Tensor:
        """`aspect.Aspect.then`: how much more a wider box looks like the first."""
        known, centre = self.beyond(first, first, roi), place[:2] + place[2:] / 2

        def alike(step: float) -> Tensor:
            size = place[2:] * torch.tensor([step, -step]).exp()
            seen = self.beyond(z, first, torch.cat([centre - size / 2, size]))
            return (seen * known).sum() / (seen.norm() * known.norm()).clamp_min(1e-9)

        return alike(aspects.STEP / 2) - alike(-aspects.STEP / 2)

    def found(
        self, fine: Tensor, before: Tensor, roi: Tensor, place: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """`likeness.Parts.found`: parts of what a map `before` had in `roi`."""
        n, points = fine.shape[-1], torch.from_numpy(ALONG)
        known = F.normalize(self.beyond(before, before, roi).flatten(1), dim=0)
        cells = F.normalize((fine - before.mean((1, 2), keepdim=True)).flatten(1), dim=0)
        where = (torch.arange(n) + 0.5) / n
        x, y = [(where - place[k]) / place[k + 2] - 0.5 for k in (0, 1)]
        places = torch.stack([points.repeat(GRID), points.repeat_interleave(GRID)])
        near = (y - places[1][:, None]).abs()[:, :, None] < WITHIN
        near = near & ((x - places[0][:, None]).abs()[:, None] < WITHIN)
        alike = (known.T @ cells).reshape(-1, n, n).masked_fill(~near, -9.0)
        best = alike.amax((1, 2))
        share = torch.softmax(alike.flatten(1) / HEAT, 1).reshape(-1, n, n)
        right, lower = share.sum(1), share.sum(2)
        found = torch.stack([right @ x, lower @ y])
        spread = right @ x**2 + lower @ y**2 - (found**2).sum(0)
        counts = best.clamp_min(0) ** 4 / (SHARP + spread)
        total = counts.sum()
        counts = counts / total.clamp_min(1e-9)
        moves = found - places
        move = moves @ counts
        scatter = (moves - move[:, None]).norm(dim=0) @ counts
        scatter = torch.where(total > 0, scatter, math.inf)

        def slope(a: Tensor, b: Tensor) -> Tensor:
            off = a - counts @ a
            grown = (counts * off) @ (b - counts @ b) / ((counts * off) @ off).clamp_min(1e-9)
            return grown.clamp_min(CLOSEST).log()

        return move, scatter, slope(places[0], found[0]) - slope(places[1], found[1])

    def slip(
        self, fine: Tensor, before: Tensor, roi: Tensor, place: Tensor, step: Tensor
    ) -> Tensor:
        """`likeness.Parts.slip`, of a box that was `place` and moved by `step` of its sides."""
        move, scatter, _ = self.found(fine, before, roi, place)
        sides = place[2:] / place[2:].prod().sqrt()
        return torch.where(scatter <= SCATTERED, ((step - move) * sides).norm(), 0.0)

    def stretched(self, box: Tensor, mean: Tensor) -> Tensor:
        """`aspect.Aspect.stretch`."""
        assert self.config.aspect
        change = (mean.abs() - self.config.aspect.slack).clamp(0, aspects.MOST) * mean.sign()
        half = torch.stack([change, -change]).double() / 2
        centre, size = box[:2] + box[2:] / 2, box[2:] * half.exp()
        return torch.cat([centre - size / 2, size])

    def sample_grid(
        self, features: Tensor, roi: Tensor, points: int = GRID, grown: float = GROWN
    ) -> Tensor:
        """`state.sample_grid`; linear interpolation as a tent around each place."""
        n = features.shape[-1]
        along = (torch.arange(points) + 0.5) / points - 0.5
        cells = torch.arange(n).float()
        x, y = [(roi[k] + roi[k + 2] / 2 + along * roi[k + 2] * grown) * n - 0.5 for k in (0, 1)]
        columns, rows = [
            (1 - (p.clamp(0, n - 1)[:, None] - cells).abs()).clamp_min(0) for p in (x, y)
        ]
        return rows @ features @ columns.T


def solve(a: Tensor, b: Tensor) -> Tensor:
    """The x (n,) for which a x = b, with a (n, n) positive: ONNX has no operator for it."""
    rows = torch.cat([a, b[:, None]], 1)
    for k in range(len(a)):
        row = rows[k] / rows[k, k].clamp_min(1e-9)
        rest = rows - rows[:, k, None] * row
        rows = torch.cat([rest[:k], row[None], rest[k + 1 :]])
    return rows[:, -1]
