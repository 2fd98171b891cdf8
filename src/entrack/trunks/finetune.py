"""Fine-tuning through the filter: features are good if eqs. 1–3 answer Y at the true place.

The filter has a closed form, so the loss is differentiated through it, as in DCFNet (Wang et al.,
2017). Templates answer to other pairs' search patches too, and there the answer should be zero.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass
from torch import Tensor, nn

from entrack import filter as cf
from entrack.config import FilterConfig, WindowConfig
from entrack.trunks import checkpoint
from entrack.trunks.distil import distance, schedule
from entrack.trunks.networks import as_input
from entrack.trunks.pairs import Pair, PairConfig, labels


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class FinetuneConfig:
    """How the trunk learns from pairs."""

    pairs: int = 60_000
    """Pairs seen in all."""
    batch: int = 16
    """Pairs a step."""
    lr: float = 3e-4
    """AdamW's peak learning rate; warm-up and cosine decay as in distillation."""
    weight_decay: float = 0.02
    """AdamW's weight decay."""
    negatives: int = 4
    """Search patches of other pairs that each template is shown."""
    negative_weight: float = 0.25
    """Weight of their squared response."""
    scale_spread: float = 0.25
    """How fast the label's height falls with the logarithm of a wrong scale."""
    anchor: float = 1.0
    """Weight of the distillation loss, which keeps the features general."""
    anchor_crops: int = 16
    """Crops a step for it."""
    stills: float = 0.4
    """Share of pairs from stills."""
    made: float = 0.3
    """Share of pairs from synthetic and cut-and-paste sequences; the rest are real clips."""
    pair: PairConfig = Field(default_factory=PairConfig)
    """The variation inside a pair."""


class Filter(nn.Module):
    """Eqs. 1–3 in torch: templates and candidates (N, C, n, n) → responses."""

    def __init__(self, cells: int, config: FilterConfig, window: WindowConfig) -> None:
        super().__init__()
        self.sigma = config.label_sigma * cells / window.context
        self.regularisation = config.regularisation
        self.register_buffer("taper", torch.from_numpy(cf.hann(cells)))
        self.register_buffer("label", torch.from_numpy(cf.spectrum(cf.label(cells, self.sigma))))
        self.taper: Tensor
        self.label: Tensor

    def fit(self, templates: Tensor) -> Tensor:
        """Ŵ (N, C, n, n // 2 + 1) of each template (eq. 2)."""
        x = cast(Tensor, torch.fft.rfft2(templates * self.taper))
        energy = x.abs().square().sum(1, keepdim=True)
        floor = self.regularisation * energy.mean((-2, -1), keepdim=True) + 1e-12
        return x.conj() * (self.label / (energy + floor))

    def respond(self, weights: Tensor, candidates: Tensor) -> Tensor:
        """M (N, n, n) (eq. 3)."""
        z = cast(Tensor, torch.fft.rfft2(candidates * self.taper))
        return cast(Tensor, torch.fft.irfft2((weights * z).sum(1), s=candidates.shape[-2:]))


def response_loss(
    filter_: Filter, templates: Tensor, searches: Tensor, wanted: Tensor, config: FinetuneConfig
) -> tuple[Tensor, Tensor]:
    """Squared distance of the responses to their labels; and the share found within a cell."""
    weights = filter_.fit(templates)
    responses = filter_.respond(weights, searches)
    loss = (responses - wanted).square().sum((-2, -1)).mean()
    for k in range(1, config.negatives + 1):
        others = filter_.respond(weights, searches.roll(k, 0))
        loss = loss + config.negative_weight / config.negatives * others.square().sum((1, 2)).mean()
    return loss, found(responses.detach(), wanted)


def found(responses: Tensor, wanted: Tensor) -> Tensor:
    """Share of responses (N, n, n) whose maximum is within one cell of the label's."""
    n = responses.shape[-1]
    a, b = responses.flatten(1).argmax(1), wanted.flatten(1).argmax(1)
    near = ((a // n - b // n).abs() <= 1) & ((a % n - b % n).abs() <= 1)
    return near.float().mean()


def finetune(
    student: nn.Module,
    draw: Callable[[np.random.Generator, int], list[Pair]],
    anchor: Callable[[np.random.Generator, int], tuple[NDArray[np.uint8], NDArray[np.float32]]],
    config: FinetuneConfig,
    run: Path,
    seed: int,
    stage: int = 1,
    report: Callable[[int, int, dict[str, float]], None] = lambda step, steps, values: None,
) -> None:
    """Train `student` in place, from `run/finetune-STAGE.safetensors` on where that exists.

    Parameters
    ----------
    draw
        Makes so many pairs.
    anchor
        Makes so many crops (N, S, S, 3) with the teacher's features, as in distillation.
    """
    steps = -(-config.pairs // config.batch)
    student.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    optimiser = torch.optim.AdamW(student.parameters(), config.lr, weight_decay=config.weight_decay)
    state = run / f"finetune-{stage}.safetensors"
    first = checkpoint.load(state, student, optimiser) if state.exists() else 0
    log = checkpoint.Log(run, f"finetune-{stage}", first)
    cells = config.pair.window.size // 16
    filter_ = Filter(cells, FilterConfig(), config.pair.window)
    student.eval()  # batch norm keeps its statistics: the filter must see what it will see later
    sums = np.zeros(3)
    since = time.monotonic()
    for step in range(first, steps):
        rng = np.random.default_rng(
            [seed, stage, step]
        )  # a resumed run sees what it would have seen
        pairs = draw(rng, config.batch)
        crops, taught = anchor(rng, config.anchor_crops)
        wanted = torch.from_numpy(labels(pairs, cells, filter_.sigma, config.scale_spread))
        both = as_input(np.stack([p.template for p in pairs] + [p.search for p in pairs]))
        for group in optimiser.param_groups:
            group["lr"] = config.lr * schedule(step, steps)
        with torch.autocast("cpu", torch.bfloat16):
            features = student(both)
            small = student(as_input(crops))
        templates, searches = features.float().chunk(2)
        loss, near = response_loss(filter_, templates, searches, wanted, config)
        keep = distance(small.float(), torch.from_numpy(taught))
        optimiser.zero_grad()
        (loss + config.anchor * keep).backward()
        nn.utils.clip_grad_norm_(student.parameters(), 5.0)
        optimiser.step()
        sums += [loss.item(), near.item(), keep.item()]
        if (step + 1) % 20 == 0 or step + 1 == steps:
            count = 20 if (step + 1) % 20 == 0 else (step + 1) % 20
            means: list[float] = (sums / count).tolist()
            values = dict[str, float](zip(("response", "found", "anchor"), means, strict=True))
            values["pairs_per_s"] = config.batch * count / (time.monotonic() - since)
            sums[:], since = 0, time.monotonic()
            log.write(step + 1, values)
            report(step + 1, steps, values)
        if (step + 1) % 200 == 0 or step + 1 == steps:
            checkpoint.save(state, student, optimiser, step + 1)
