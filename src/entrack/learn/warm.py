"""The warm start: f1 and the policy's head learn from pairs of views before they act (row 23).

Each row of a bank is one look: what a tracker sees whose last box is of wrong place and size, and
where the target is. The head answers with a Gaussian over the action that would hit it.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass
from torch import Tensor, nn

from entrack.learn.networks import Actor, AttentionActor, Basis, ConditionedF1, States
from entrack.policy import LinearHead
from entrack.state import f2
from entrack.trunks import checkpoint
from entrack.trunks.distil import schedule

Bank = Mapping[str, NDArray[np.generic]]
"""`features` (N, C, n, n), `points` (N, C, 8, 8), `response` (N, n, n), `box` and `held` (N, 4);
boxes `(x, y, w, h)` in shares of the search patch's side, `held` as of `entrack.state`."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class WarmConfig:
    """How f1 and the head learn from the bank."""

    steps: int = Field(default=3000, ge=1)
    """Batches seen."""
    batch: int = Field(default=128, ge=1)
    """Looks a batch."""
    lr: float = 1e-3
    """AdamW's peak learning rate; warm-up and cosine decay."""
    weight_decay: float = 1e-3
    """AdamW's weight decay."""
    heat: float = 0.2
    """Weight of the loss that puts the attention on the target."""
    likelihood: float = 0.1
    """Weight of the likelihood of the error under σ."""
    width: int = 64
    """Channels of z."""
    dropout: float = Field(default=0.0, ge=0, lt=1)
    """Share of Z's components that are hidden in each look, in template and candidate alike."""


def imitation_loss(
    mean: Tensor, log_std: Tensor, heat: Tensor | None, box: Tensor, held: Tensor, reach: float,
    config: WarmConfig,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """How far the mean action is from the one that hits `box`; and the overlap it reaches (N,).

    `heat` (N, cells) is None for a policy that attends to nothing.
    """
    held = held[:, :2]
    sides = torch.cat([held, held], 1)
    low, high = box[:, :2] - 0.5, box[:, :2] + box[:, 2:] - 0.5
    truth = torch.cat([low + held / 2, high - held / 2], 1) / sides  # as an action
    action = reach * torch.tanh(mean)
    corners = torch.cat([-held / 2, held / 2], 1)
    overlap, gap = _iou(corners + action * sides, torch.cat([low, high], 1))
    distance = F.smooth_l1_loss(action, truth, beta=0.1)
    # σ is learned before the tanh, where the policy is a Gaussian; the mean is left to the others.
    error = torch.atanh((truth / reach).clamp(-0.999, 0.999)) - mean.detach()
    surprise = (log_std + 0.5 * (error / log_std.exp()).square()).mean()
    loss = 2 * distance + (1 - overlap + gap).mean() + config.likelihood * surprise
    if heat is not None:
        loss = loss + config.heat * _inattention(heat, (low + high) / 2)
    return loss, overlap.detach()


def _inattention(heat: Tensor, centre: Tensor) -> Tensor:
    """Cross-entropy of the attention and a Gaussian about the target's centre (N, 2)."""
    n = round(heat.shape[1] ** 0.5)
    along = (torch.arange(n) + 0.5) / n - 0.5
    x, y = centre.unbind(1)
    square = (along[None, None] - x[:, None, None]) ** 2 + (
        along[None, :, None] - y[:, None, None]
    ) ** 2
    wanted = torch.exp(-square * n**2 / (2 * 0.7**2)).flatten(1)  # σ: 0.7 cells
    wanted = wanted / wanted.sum(1, keepdim=True).clamp_min(1e-6)
    return -(wanted * torch.log_softmax(heat, 1)).sum(1).mean()


def _iou(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """IoU of boxes by their corners, and the share of the hull that neither covers (GIoU)."""
    shared = (torch.min(a[:, 2:], b[:, 2:]) - torch.max(a[:, :2], b[:, :2])).clamp_min(0).prod(1)
    hull = (torch.max(a[:, 2:], b[:, 2:]) - torch.min(a[:, :2], b[:, :2])).clamp_min(1e-4).prod(1)
    areas = [(c[:, 2:] - c[:, :2]).clamp_min(1e-4).prod(1) for c in (a, b)]
    union = areas[0] + areas[1] - shared
    return shared / union, (hull - union) / hull


def look(
    f1: ConditionedF1 | Basis, bank: Bank, rows: NDArray[np.intp], shown: Tensor | None = None
) -> tuple[States, Tensor, Tensor]:
    """States (z, m) of some rows of a bank; with the boxes and the shapes held.

    With a basis in place of f1, z is Z itself, of which a linear policy's f1 is a part, and m is
    the paper's. `shown` (N, C) is what every component of Z is multiplied by.
    """
    part = {k: torch.from_numpy(np.ascontiguousarray(a[rows])).float() for k, a in bank.items()}
    if shown is not None:
        for key in ("features", "points"):
            part[key] = part[key] * shown[:, :, None, None]
    if isinstance(f1, Basis):
        m = np.stack([f2(response, LinearHead.side) for response in part["response"].numpy()])
        states = States(f1.restored(part["features"]), torch.from_numpy(m), part["held"])
        return states, part["box"], part["held"]
    z = f1(part["features"], part["points"], part["response"], part["held"])
    return States(z, part["response"].flatten(1), part["held"]), part["box"], part["held"]


def warm_start(
    f1: ConditionedF1 | Basis,
    actor: Actor,
    load: Callable[[], Bank],
    config: WarmConfig,
    run: Path,
    seed: int,
    report: Callable[[int, int, dict[str, float]], None] = lambda step, steps, values: None,
) -> None:
    """Train f1 and the head in place, from `run/warm.safetensors` on where that exists.

    A linear actor has its f1 in itself, and is given the basis of the bank.

    One row in twenty of the bank is kept for checking. `load` is not called where all is learned:
    a bank takes gigabytes.
    """
    both = nn.ModuleList([f1, actor])
    optimiser = torch.optim.AdamW(both.parameters(), config.lr, weight_decay=config.weight_decay)
    state = run / "warm.safetensors"
    first = checkpoint.load(state, both, optimiser) if state.exists() else 0
    if first >= config.steps:
        return
    log, bank = checkpoint.Log(run, "warm", first), load()
    every = np.arange(len(bank["box"]))
    train, check = every[every % 20 != 0], every[every % 20 == 0][:1000]
    sums: list[tuple[float, float]] = []
    for step in range(first, config.steps):
        rng = np.random.default_rng([seed, 2, step])
        rows = np.sort(rng.choice(train, config.batch))
        keep = rng.random((config.batch, bank["features"].shape[1])) >= config.dropout
        shown = torch.from_numpy(keep.astype(np.float32) / (1 - config.dropout))
        for group in optimiser.param_groups:
            group["lr"] = config.lr * schedule(step, config.steps)
        states, box, held = look(f1, bank, rows, shown)
        mean, log_std, heat = _act(actor, states)
        loss, overlap = imitation_loss(mean, log_std, heat, box, held, actor.reach, config)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(both.parameters(), 1.0)
        optimiser.step()
        sums.append((loss.item(), overlap.mean().item()))
        if (step + 1) % 200 == 0 or step + 1 == config.steps:
            loss_mean, iou_mean = np.mean(sums, axis=0).tolist()
            held_out = evaluate(f1, actor, bank, check, config)
            values: dict[str, float] = {
                "loss": loss_mean,
                "iou": iou_mean,
                "iou_held_out": held_out,
            }
            sums.clear()
            log.write(step + 1, values)
            report(step + 1, config.steps, values)
            checkpoint.save(state, both, optimiser, step + 1)


def _act(actor: Actor, states: States) -> tuple[Tensor, Tensor, Tensor | None]:
    mean, log_std, heat = actor(states)
    return mean, log_std, heat if isinstance(actor, AttentionActor) else None


@torch.no_grad()
def evaluate(
    f1: ConditionedF1 | Basis, actor: Actor, bank: Bank, rows: NDArray[np.intp], config: WarmConfig
) -> float:
    """Mean overlap after one action."""
    overlaps: list[Tensor] = []
    for part in np.array_split(rows, max(1, len(rows) // 200)):
        states, box, held = look(f1, bank, part)
        mean, log_std, heat = _act(actor, states)
        overlaps.append(imitation_loss(mean, log_std, heat, box, held, actor.reach, config)[1])
    return torch.cat(overlaps).mean().item()
