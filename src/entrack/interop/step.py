"""What a tracker does with a frame's features, in torch, for `entrack export`.

Each function here is one of `entrack.likeness`, `aspect`, `recovery`, `state` or `policy`, by the
same name, on the same weights: who changes one there changes it here, and the tests compare whole
sequences. Filter, colours and likeness are in `step_filter`, `step_colour` and `step_likeness`.
"""
# pyright: basic

from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from entrack.config import Config
from entrack.interop.step_colour import Colouring
from entrack.interop.step_likeness import Known, Matching
from entrack.likeness import AROUND, CLEARLY, FINER
from entrack.policy import LOG_STD, OUTWARDS, Policy
from entrack.recovery import (
    ELSEWHERE,
    FAINT,
    FORGET,
    HERE,
    LEAST,
    MOST,
    NOTHING,
    ORIGIN,
    POINTS,
    RESTLESS,
    UNREST,
)
from entrack.state import Conditioned
from entrack.state import _resize as resize_matrix  # pyright: ignore[reportPrivateUsage]
from entrack.tracker import PLACES


class Step(Matching):
    """Filter and policy: eqs. 1–7 and 14, for one target."""

    def __init__(self, config: Config, policy: Policy | None) -> None:
        super().__init__(config)
        self.policy, self.middle, n = policy, config.scale.steps // 2, self.n
        self.compares = config.score.compares
        self.remembers = policy is not None and isinstance(policy.f1, Conditioned)
        self.keeps_first = self.remembers or self.compares
        self.keeps_first |= config.likeness is not None or config.aspect is not None
        self.remembered = ["first_size", "template", "score"]
        self.remembered += ["first", "roi"] if self.keeps_first else []
        self.remembered += ["past"] if config.score.recalls else []
        self.remembered += ["turn"] if config.scale.every > 1 else []
        self.remembered += ["colours", "tint"] if config.colour else []
        self.remembered += ["first_fine"] if config.likeness or config.aspect else []
        self.remembered += ["inside", "inside_fine"] if config.likeness else []
        self.remembered += ["aspect"] if config.aspect else []
        self.leaps = config.likeness is not None and config.score.leaps
        self.remembered += ["last_fine", "last_roi"] if self.leaps else []
        self.colouring = Colouring(config.colour, n) if config.colour else None
        weights = {} if policy is None else _weights(policy, n)
        self.w = {name: torch.from_numpy(np.array(w, np.float32)) for name, w in weights.items()}

    def forward(
        self, features: Tensor, box: Tensor, image: Tensor, first_size: Tensor, template: Tensor,
        score: Tensor, first: Tensor, roi: Tensor, past: Tensor, turn: Tensor, patches: Tensor,
        colours: Tensor, tint: Tensor, aspect: Tensor, fine: Tensor, first_fine: Tensor,
        inside: Tensor, inside_fine: Tensor, last_fine: Tensor, last_roi: Tensor,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        """See the card that `export_model` writes."""
        config, new = self.config, (first_size[0] == 0).float()
        # Pixels in float64, as the tracker has them; in float32, boxes on 1 / 256 pixel are exact.
        box, image, first_size = box.double(), image.double(), first_size.double()
        size = box[2:]
        first_size = first_size + new * size
        side = size.prod().sqrt().expand(2) if config.window.shape == "square" else size
        window = side * config.window.context
        share = (size / window).float()
        place = torch.cat([0.5 - share / 2, share])  # of the last box in the window around it
        roi = roi + new * place
        first = first + new * features[0]
        if config.scale.every == 1:
            turn = torch.zeros(())
        again = config.update.seen == "again"
        rate = torch.maximum(new, self.rate(score)) if again else new
        template = (1 - rate) * template + rate * (features[0] * self.taper)  # eq. 14
        held = torch.cat([share, (size / first_size).log().float()])
        if self.colouring:
            first_colours, first_tint = self.colouring.first(patches[0], roi)
            colours, tint = colours + new * first_colours, tint + new * first_tint
        first_fine = first_fine + new * fine[0]
        if config.likeness:
            inside = inside + new * self.beyond(first, first, roi)
            inside_fine = inside_fine + new * self.beyond(first_fine, first_fine, roi, FINER)
        known = Known(first, first_fine, roi, inside, inside_fine)
        move, seen, used, wider, *sigma = self.answer(
            template, features[1:], fine[1:], held, known, turn, patches[1:], colours
        )
        before, last = box[:2] + size / 2, size.prod().sqrt()
        centre = before + move[:2].double() * window
        centre = torch.minimum(centre.clamp_min(0), image)
        size, limits = size * move[2:].double(), config.limits
        size = torch.minimum(size, limits.largest * first_size)
        size = torch.maximum(size, limits.smallest * first_size)
        centre, size = (torch.round(v * PLACES) / PLACES for v in (centre, size))
        box = torch.cat([centre - size / 2, size])
        slip = None
        if self.leaps:
            last_fine, last_roi = last_fine + new * fine[0], last_roi + new * roi
            step = ((centre - before) / window).float() / share
            slip = self.slip(fine[1:][0], last_fine, last_roi, place, step)
        past = self.followed(past, (centre - before).float(), last.float(), seen, slip)
        leap = (LEAST + past[2].clamp_max(MOST)).log()
        seen |= {"leap": leap, "unrest": past[3].clamp_max(UNREST)}
        wide = window * self.zooms[used].double()
        place = torch.cat([(box[:2] - before) / wide + 0.5, size / wide]).float()
        if self.leaps:
            last_fine, last_roi = fine[1:][0], place
        coloured = None
        if self.colouring:
            coloured = self.colouring.see(patches[1:][used][0], place, colours)
            seen["colour"] = self.colouring.change(colours, coloured[0])
            leapt = (past[2].clamp_max(MOST) / LEAST).log1p()
            seen["swap"] = self.colouring.strange(tint, coloured[2]) * leapt
        score = torch.sigmoid(self.total(seen))
        learns = (score >= config.update.min_score).float()
        if self.colouring and coloured:
            colours, tint = self.colouring.learn(colours, tint, coloured, score, learns)
        if config.likeness:
            rate = config.likeness.rate * learns
            z, z_fine = features[1:][used][0], fine[1:][used][0]
            inside = (1 - rate) * inside + rate * self.beyond(z, first, place)
            finer = self.beyond(z_fine, first_fine, place, FINER)
            inside_fine = (1 - rate) * inside_fine + rate * finer
        if config.aspect:
            found = self.looks_wider(features[1:][used][0], first, roi, place)
            found = config.aspect.action * wider + config.aspect.alike * found
            if config.aspect.parts:
                *_, apart = self.found(fine[1:][used][0], first_fine, roi, place)
                found = found + config.aspect.parts * apart
            aspect = aspect + config.aspect.rate * learns * (found - aspect)
        if not again:
            side = size.prod().sqrt().expand(2) if config.window.shape == "square" else size
            side = side * config.window.context
            place = torch.cat([(centre - side / 2 - before) / wide + 0.5, side / wide]).float()
            x = self.sample_grid(features[1:][used][0], place, self.n, 1.0) * self.taper
            rate = self.rate(score)
            template = (1 - rate) * template + rate * x
        memory = {
            "first_size": first_size.float(), "template": template, "score": score,
            "first": first, "roi": roi, "past": past,
            "turn": torch.where(turn > 0, turn - 1, config.scale.every - 1.0), "colours": colours,
            "tint": tint, "aspect": aspect, "first_fine": first_fine, "inside": inside,
            "inside_fine": inside_fine, "last_fine": last_fine, "last_roi": last_roi,
        }  # fmt: skip
        told = self.stretched(box, aspect) if config.aspect else box
        return box.float(), told.float(), *sigma, *(memory[name] for name in self.remembered)

    def rate(self, score: Tensor) -> Tensor:
        """θ of eq. 14, where the score is high enough."""
        update = self.config.update
        return update.rate * (score >= update.min_score).float()

    def answer(
        self, template: Tensor, features: Tensor, fine: Tensor, held: Tensor, known: Known,
        turn: Tensor, patches: Tensor, colours: Tensor,
    ) -> tuple[Any, ...]:  # fmt: skip
        """What is found in this frame's features.

        How far the box moves and grows (4,), in windows and sizes; the evidence for the score; the
        index (1,) of the size that was used; how much wider the action makes it; maybe σ.
        """
        responses = self.respond(template, features * self.taper)
        middle, heights = self.middle, responses.amax((1, 2))
        elsewhere = (torch.arange(len(heights)) != middle) & (turn > 0)  # sizes not looked at
        best = (heights * self.penalties - 1e9 * elsewhere).argmax(0, keepdim=True)
        zoom, scale = self.zooms[best], self.config.scale
        grown = scale.rate * (self.highest(heights) if scale.between else zoom - 1)
        growth = grown.exp() if scale.between else 1 + grown
        growth = torch.where(turn > 0, 1.0, growth)
        if self.policy is None:
            response = self.weigh(responses[best][0], patches[best][0], held[:2] / zoom, colours)
            dx, dy, height, psr = self.peak(response)
            offset = torch.stack([dx, dy]) * zoom / self.n
            if self.config.likeness:
                offset, growth = self.fit(features[0], fine[0], held, known, offset)
            size = torch.cat([growth, growth])
            evidence = {"peak": height, "psr": psr.clamp_min(1e-3).log()}
            evidence |= self.compared(features[best][0], known, held, zoom, offset, size)
            return torch.cat([offset, size]), evidence, best, torch.zeros(())
        response = self.weigh(responses[middle], patches[middle], held[:2], colours)
        _, _, height, psr = self.peak(response)
        mean, log_std = self.act(features[middle], response, held, known)
        reach = self.policy.config.reach
        action = reach * torch.tanh(mean)
        log_std = log_std.clamp(*LOG_STD)
        sigma = log_std.exp() * reach * (1 - torch.tanh(mean) ** 2)
        low, high = action[:2] - 0.5, action[2:] + 0.5  # eq. 7, in box sizes from its centre
        low, high = torch.minimum(low, high), torch.maximum(low, high)
        offset = (low + high) / 2 * held[:2]
        if self.config.likeness:
            offset, growth = self.fit(features[middle], fine[middle], held, known, offset)
        size, (w, h) = self.temper(high - low, growth), (high - low).clamp_min(1e-6).log()
        evidence = {"peak": height, "psr": psr.clamp_min(1e-3).log(), "sigma": sigma.log().mean()}
        evidence |= self.compared(features[middle], known, held, 1.0, offset, size)
        return torch.cat([offset, size]), evidence, torch.tensor([middle]), w - h, sigma

    def weigh(self, response: Tensor, patch: Tensor, size: Tensor, colours: Tensor) -> Tensor:
        """`target.Target.coloured`."""
        if self.colouring is None:
            return response
        return self.colouring.weigh(response, patch, size, colours)

    def temper(self, size: Tensor, searched: Tensor) -> Tensor:
        """`Tracker._acted`: how much of the change of size is not the action's."""
        assert self.policy is not None
        config = self.policy.config
        if not (config.search or config.keep_aspect):
            return size
        growth = size.clamp_min(1e-6).log()
        if config.keep_aspect:
            growth = growth.mean(0, keepdim=True).expand(2)
        return torch.exp((1 - config.search) * growth + config.search * searched.log())

    def total(self, evidence: dict[str, Tensor]) -> Tensor:
        """`Weights.total`."""
        config = self.config.score
        weights = {name: getattr(config, name) for name in evidence}
        parts = [w * evidence[name] for name, w in weights.items() if w]
        return torch.stack([torch.tensor(config.bias), *parts]).sum()

    def followed(
        self, past: Tensor, step: Tensor, size: Tensor, seen: dict[str, Tensor], slip: Tensor | None
    ) -> Tensor:
        """`recovery.Search.follow`."""
        away = ((step - past[:2]).norm() / size).clamp_max(1.0)
        leapt = (away if slip is None else slip.clamp_max(1.0)) * seen.get("rival", torch.ones(()))
        leap = torch.maximum((1 - FORGET) * past[2], leapt)
        unrest = (1 - RESTLESS) * past[3] + RESTLESS * away
        return torch.cat([(past[:2] + step) / 2, torch.stack([leap, unrest])])

    def compared(
        self, z: Tensor, known: Known, held: Tensor, zoom: Any, offset: Tensor, size: Tensor
    ) -> dict[str, Tensor]:
        """`recovery.Origin` and `Likeness.off`: how much the new box looks like the first."""
        n, first, roi = self.n, known.first, known.roi
        box = torch.cat([0.5 + offset / zoom, held[:2] * size / zoom])
        evidence: dict[str, Tensor] = {}
        if self.config.likeness and self.config.score.off:
            away = self.off(z, first, roi, box, AROUND).norm() / CLEARLY
            evidence["off"] = away.clamp_max(1.0) ** 2
        if not self.compares:
            return evidence
        away = (
            (torch.arange(n) - n / 2).abs() / (n * ORIGIN * (roi[2] * roi[3]).sqrt())
        ).clamp_max(0.5)
        line = 0.5 + 0.5 * torch.cos(2 * torch.pi * away)
        response = self.respond(first * line[:, None] * line, (z * self.taper)[None])[0]
        centre, shares = box[:2], box[2:]  # in shares of the window that was looked at
        dx, dy = [((torch.arange(n) - c * n + n / 2) % n - n / 2).abs() for c in centre]
        apart = torch.maximum(dy[:, None].expand(n, n), dx[None].expand(n, n))
        height = response.masked_fill(apart > HERE, -1e9).max()
        rival = response.masked_fill(apart <= ELSEWHERE, -1e9).max() / height.clamp_min(FAINT)
        mean = first.mean((1, 2), keepdim=True)
        seen = self.sample_grid(z, torch.cat([centre - shares / 2, shares]), POINTS, 1.0) - mean
        points = self.sample_grid(first, roi, POINTS, 1.0) - mean
        length = (seen.norm() * points.norm()).clamp_min(1e-9)
        return evidence | {
            "first": height, "unseen": 1 - (height / NOTHING).clamp(0, 1),
            "rival": rival.clamp(0, 2), "same": (seen * points).sum() / length,
        }  # fmt: skip

    def act(
        self, features: Tensor, response: Tensor, held: Tensor, known: Known
    ) -> tuple[Tensor, Tensor]:
        """μ and log σ (4,) of s = (f1(Z), f2(M))."""
        w = self.w
        if not self.remembers:  # state.Linear, policy.LinearHead
            z = (w["f1.weight"] @ features.flatten(1)).flatten() + w["f1.bias"]
            m = (w["resize"] @ response @ w["resize"].T).flatten()
            if w["mean.weight"].shape == w["log_std.weight"].shape:
                z = m = torch.cat([z, m])
            mean = w["mean.weight"] @ z + w["mean.bias"]
            return mean, w["log_std.weight"] @ m + w["log_std.bias"]
        z = self.conditioned(features, response, held, self.sample_grid(known.first, known.roi))
        out = w["head.weight"] @ z + w["head.bias"][:, None]  # policy.AttentionHead
        attention = torch.softmax(out[0] + w["head.beta"] * response.flatten(), 0)
        x, y = self.along().repeat(self.n), self.along().repeat_interleave(self.n)
        outwards = torch.from_numpy(OUTWARDS)
        places = torch.stack([x / held[0], y / held[1], x / held[0], y / held[1]])
        sides = places + out[1:5].exp() * outwards[:, None]
        assert self.policy is not None
        offset = ((sides @ attention - outwards) / self.policy.config.reach).clamp(-0.999, 0.999)
        return 0.5 * ((1 + offset) / (1 - offset)).log(), out[5:9] @ attention

    def conditioned(
        self, features: Tensor, response: Tensor, held: Tensor, points: Tensor
    ) -> Tensor:
        """`state.Conditioned`."""
        w, n = self.w, self.n

        def project(x: Tensor, name: str) -> Tensor:
            return w[f"f1.{name}.weight"] @ x.flatten(1) + w[f"f1.{name}.bias"][:, None]

        keys = F.normalize(project(points, "match"), dim=0)
        gate = project(points[:, 1:-1, 1:-1].mean((1, 2))[:, None], "gate")
        matched = F.normalize(project(features, "match"), dim=0)
        planes = torch.stack([2 * response, response / response.max().clamp_min(0.05)]).flatten(1)
        seen = [4 * keys.T @ matched, torch.relu(project(features, "belong")) * gate]
        seen += [project(features, "itself"), planes, self.place(held)]
        x = torch.relu(w["f1.mix.weight"] @ torch.cat(seen) + w["f1.mix.bias"][:, None])
        x = x.reshape(1, -1, n, n)
        for k in range(sum("convs" in name and "weight" in name for name in w)):
            kernel = w[f"f1.convs.{k}.weight"].reshape(-1, 3, 3, x.shape[1]).permute(0, 3, 1, 2)
            x = x + torch.relu(F.conv2d(x, kernel, w[f"f1.convs.{k}.bias"], padding=1))
        return x[0].flatten(1)

    def place(self, held: Tensor) -> Tensor:
        """`state.place`."""
        n, along = self.n, self.along()
        x, y = along.repeat(n, 1), along[:, None].repeat(1, n)
        soft = [torch.sigmoid(40 * (held[k] / 2 - c.abs())) for k, c in enumerate((x, y))]
        grown = [held[k].expand(n, n) for k in (2, 3)]
        planes = [2 * x, 2 * y, 4 * (x * x + y * y), soft[0] * soft[1], *grown]
        return torch.stack(planes).flatten(1)

    def along(self) -> Tensor:
        """Centres of the cells from the window's, in shares of its side."""
        return (torch.arange(self.n) + 0.5) / self.n - 0.5


def _weights(policy: Policy, n: int) -> dict[str, np.ndarray]:
    """Everything that f1 and the head know, by the names in policy.safetensors."""
    head: dict[str, np.ndarray] = dict(policy.head.w)  # type: ignore[attr-defined]
    if isinstance(policy.f1, Conditioned):
        own = {f"f1.{name}": w for name, w in policy.f1.w.items()}
        return {**own, **{k: w for k, w in head.items() if k.startswith("head.")}}
    return {**head, "resize": resize_matrix(n, policy.head.side)}
