"""Distillation: a student learns to say what the reference trunk says about pictures."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass
from torch import Tensor, nn
from torch.nn import functional as F

from entrack.trunks import checkpoint, crops
from entrack.trunks.networks import as_input


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class DistilConfig:
    """How the student learns from the teacher."""

    crops: int = 200_000
    """Crops seen in all."""
    size: int = 144
    """Side of a crop, pixels."""
    batch: int = 64
    """Crops a step."""
    lr: float = 2e-3
    """AdamW's peak learning rate; it warms up for 3 % of the steps and decays as a cosine."""
    weight_decay: float = 0.02
    """AdamW's weight decay."""


def distance(student: Tensor, teacher: Tensor) -> Tensor:
    """Mean squared error, relative to the teacher's power, plus 1 − cosine, cell by cell."""
    square = F.mse_loss(student, teacher) / teacher.square().mean()
    return square + (1 - F.cosine_similarity(student, teacher, dim=1)).mean()


def schedule(step: int, steps: int) -> float:
    """Share of the peak learning rate: linear warm-up, then a cosine to 1 %."""
    warm = max(1, round(0.03 * steps))
    if step < warm:
        return (step + 1) / warm
    return 0.01 + 0.99 * 0.5 * (1 + np.cos(np.pi * (step - warm) / max(1, steps - warm)))


def distil(
    student: nn.Module,
    teach: Callable[[NDArray[np.uint8]], NDArray[np.float32]],
    pictures: Sequence[crops.Image],
    config: DistilConfig,
    run: Path,
    seed: int,
    report: Callable[[int, int, dict[str, float]], None] = lambda step, steps, values: None,
) -> None:
    """Train `student` in place, from `run/distil.safetensors` on where that exists.

    Parameters
    ----------
    teach
        Maps crops (N, S, S, 3) BGR uint8 to the teacher's features (N, 256, S/16, S/16).
    report
        Called every 20 steps with the step, the number of steps, and losses.
    """
    steps = -(-config.crops // config.batch)
    student.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    optimiser = torch.optim.AdamW(student.parameters(), config.lr, weight_decay=config.weight_decay)
    state = run / "distil.safetensors"
    first = checkpoint.load(state, student, optimiser) if state.exists() else 0
    log = checkpoint.Log(run, "distil", first)
    student.train()
    since = time.monotonic()
    for step in range(first, steps):
        rng = np.random.default_rng([seed, step])  # a resumed run sees what it would have seen
        patches = crops.batch(pictures, config.batch, config.size, rng)
        target = torch.from_numpy(teach(patches))
        for group in optimiser.param_groups:
            group["lr"] = config.lr * schedule(step, steps)
        with torch.autocast("cpu", torch.bfloat16):
            features = student(as_input(patches))
        loss = distance(features.float(), target)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(student.parameters(), 5.0)
        optimiser.step()
        if (step + 1) % 20 == 0 or step + 1 == steps:
            rate = config.batch * 20 / (time.monotonic() - since)
            since = time.monotonic()
            values = {"loss": loss.item(), "crops_per_s": rate}
            log.write(step + 1, values)
            report(step + 1, steps, values)
        if (step + 1) % 200 == 0 or step + 1 == steps:
            checkpoint.save(state, student, optimiser, step + 1)
