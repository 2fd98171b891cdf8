"""`entrack.colour` in torch, for `entrack.interop.step`: by the same names, on the same numbers."""
# pyright: basic

import torch
from torch import Tensor

from entrack.colour import (
    CORE,
    DARK,
    DOUBT,
    INNER,
    LEAST,
    NEAR,
    ORDINARY,
    OTHERS,
    OUTER,
    RARE,
    SLOW,
    STEADY,
    STEPS,
    STRIDE,
    SURE,
    YOUNG,
)
from entrack.config import ColourConfig

REACH, PARTS = 2.4, 4096
"""Tints of pixels are within the first of these, and counted in so many parts of that."""


class Colouring:
    """What a step does with colours, for responses of n × n cells.

    Two things are remembered: `colours` (4, bins³), which are the first shares, the running means
    of those inside and around, and the chances; and `tint` (5,): its mean, spread and frames.
    """

    def __init__(self, config: ColourConfig, n: int) -> None:
        self.config, self.n = config, n

    def first(self, patch: Tensor, roi: Tensor) -> tuple[Tensor, Tensor]:
        """`colour.Colours.of`: colours and tint of the first frame's box."""
        codes = self.codes(patch)
        own, others = self.seen(codes, roi)
        chance = self.chance(own, others)
        tint = self.tint(patch, codes, roi, chance)
        rest = torch.tensor([STEADY, 1.0])
        return torch.stack([own, own, others, chance]), torch.cat([tint, rest])

    def see(self, patch: Tensor, roi: Tensor, colours: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """`colour.Colours.see`: shares inside and around a later box, and its tint."""
        codes = self.codes(patch)
        return *self.seen(codes, roi), self.tint(patch, codes, roi, colours[3])

    def change(self, colours: Tensor, own: Tensor) -> Tensor:
        """`colour.Colours.change`."""
        return (LEAST + (1 - (colours[0] * own).sqrt().sum()).clamp_min(0)).log()

    def strange(self, tint: Tensor, now: Tensor) -> Tensor:
        """`colour.Colours.strange`."""
        off = (now - tint[:3]).norm() / (STEADY + tint[3])
        return (off - ORDINARY).clamp_min(0) / (off + ORDINARY)

    def learn(
        self, colours: Tensor, tint: Tensor, seen: tuple[Tensor, Tensor, Tensor], score: Tensor,
        learns: Tensor,
    ) -> tuple[Tensor, Tensor]:  # fmt: skip
        """`colour.Colours.learn`, where `learns` is 1 and not 0."""
        own, others, now = seen
        rate = self.config.rate * learns
        shares = (1 - rate) * colours[1:3] + rate * torch.stack([own, others])
        mean, spread, frames = tint[:3], tint[3], tint[4]
        young = (frames < YOUNG).float()
        rate = learns * torch.where(young > 0, 1 / (frames + 1), SLOW * (score >= SURE).float())
        wider = rate * young * ((now - mean).norm() - spread)
        rest = torch.stack([spread + wider, frames + learns * young])
        colours = torch.cat([colours[:1], shares, colours[3:]])
        return colours, torch.cat([(1 - rate) * mean + rate * now, rest])

    def codes(self, patch: Tensor) -> Tensor:
        """`colour.codes`: (S / 2, S / 2)."""
        bins = self.config.bins
        b, g, r = torch.floor(patch[:, ::STRIDE, ::STRIDE] / (256 // bins)).long()
        return (b * bins + g) * bins + r

    def seen(self, codes: Tensor, roi: Tensor) -> tuple[Tensor, Tensor]:
        """`colour.Seen.of`: shares (bins³,) of colours inside and around a box."""
        none = torch.zeros(self.config.bins**3)
        inner, outer = [self.within(roi, f, codes.shape[0]) for f in (INNER, OUTER)]
        counts = [none.scatter_add(0, codes.flatten(), w.flatten()) for w in (inner, 1 - outer)]
        inside, around = [c / c.sum().clamp_min(1e-9) for c in counts]
        return inside, around

    def chance(self, own: Tensor, around: Tensor) -> Tensor:
        """`colour.chance_of`."""
        return own / (own + around + RARE)

    def tint(self, patch: Tensor, codes: Tensor, roi: Tensor, chance: Tensor) -> Tensor:
        """`colour.Seen.of`: the tint (3,) of a box."""
        weights = self.within(roi, CORE, codes.shape[0]) * (chance[codes] + OTHERS)
        logs = (patch[:, ::STRIDE, ::STRIDE] + DARK).log().flatten(1)
        return self.commonest(logs - logs.mean(0), weights.flatten())

    def commonest(self, tints: Tensor, weights: Tensor) -> Tensor:
        """`colour.commonest`; the window's pixels are too many to sort them."""
        parts = ((tints + REACH) * (PARTS / 2 / REACH)).long().clamp(0, PARTS - 1)
        counts = torch.zeros(3, PARTS).scatter_add(1, parts, weights.expand(3, -1))
        median = (counts.cumsum(1) < weights.sum() / 2).sum(1)
        found = (median + 0.5) * (2 * REACH / PARTS) - REACH
        for _ in range(STEPS):
            off = (tints - found[:, None]).square().sum(0)
            near = weights * ((-0.5 / NEAR**2 * off).exp() + RARE)
            found = tints @ near / near.sum().clamp_min(1e-9)
        return found

    def within(self, roi: Tensor, share: float, n: int) -> Tensor:
        """How much of each of n × n pixels a box covers, of whose sides only a share counts."""
        x, y = roi[:2] + roi[2:] / 2
        rows = self.covered(y[None], share * roi[3], n)
        return rows.T * self.covered(x[None], share * roi[2], n)

    def covered(self, centres: Tensor, length: Tensor, n: int) -> Tensor:
        """`colour.covered`: (m, n)."""
        middle = n * centres[:, None] - torch.arange(n)
        half = n * length / 2
        return (middle + half).clamp(0, 1) - (middle - half).clamp(0, 1)

    def weigh(self, response: Tensor, patch: Tensor, size: Tensor, colours: Tensor) -> Tensor:
        """`colour.Colours.weigh`."""
        own, around, codes = (colours[0] + colours[1]) / 2, colours[2], self.codes(patch)
        chance = self.chance(own, around)
        places = torch.arange(self.n) / self.n + (0.5 - self.n // 2 / self.n)
        columns, rows = [self.covered(places, INNER * side, codes.shape[0]) for side in size]
        columns, rows = [c / c.sum(1, keepdim=True) for c in (columns, rows)]
        found = rows @ chance[codes] @ columns.T + DOUBT
        weight = (found / found.max()) ** self.config.power
        return torch.where(response > 0, weight * response, response)
