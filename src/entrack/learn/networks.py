"""The networks in torch: f1, the policy's heads, and the critic. They learn here, and run in numpy.

Names and shapes follow `entrack.state` and `entrack.policy`; `weights_of` writes what those read.
"""

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor, nn

from entrack.policy import LOG_STD, OUTWARDS
from entrack.state import GRID, place

Weights = dict[str, NDArray[np.float32]]
PART = 32
"""States that an update reads at a time."""


class States(NamedTuple):
    """A batch of states; `z` is Z itself where f1 is learned with the policy (paper, row 9)."""

    z: Tensor
    """(N, C, n, n)."""
    m: Tensor
    """(N, k): f2(M)."""
    held: Tensor
    """(N, 4): the last box, see `entrack.state.held`."""

    def __getitem__(self, rows: object) -> "States":  # type: ignore[override]
        return States(*(tensor[rows] for tensor in tuple(self)))  # type: ignore[index]


class Basis(nn.Module):
    """A fixed linear map of Z's channels to fewer, about zero: what a bank of pairs stores."""

    def __init__(self, mean: NDArray[np.float32], vectors: NDArray[np.float32]) -> None:
        super().__init__()
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("vectors", torch.from_numpy(vectors))
        self.mean: Tensor
        self.vectors: Tensor

    def merged(self, weight: Tensor, bias: Tensor) -> tuple[Tensor, Tensor]:
        """A layer on reduced features as one on Z."""
        whole = weight @ self.vectors.T
        return whole, bias - whole @ self.mean

    def restored(self, features: Tensor) -> Tensor:
        """Z (N, C, n, n) from what is kept of it (N, k, n, n): the vectors are orthogonal."""
        back = self.vectors / self.vectors.square().sum(0)
        return torch.einsum("ck,nkij->ncij", back, features) + self.mean[:, None, None]


class ConditionedF1(nn.Module):
    """`entrack.state.Conditioned`, for features that `basis` has reduced."""

    def __init__(
        self, inputs: int, match: int = 48, belong: int = 32, itself: int = 16, width: int = 64
    ) -> None:
        super().__init__()
        self.match = nn.Linear(inputs, match)
        self.belong = nn.Linear(inputs, belong)
        self.gate = nn.Linear(inputs, belong)
        self.itself = nn.Linear(inputs, itself)
        self.mix = nn.Linear(GRID * GRID + belong + itself + 2 + 6, width)
        self.convs = nn.ModuleList(nn.Conv2d(width, width, 3, padding=1) for _ in range(3))

    def forward(self, features: Tensor, points: Tensor, response: Tensor, held: Tensor) -> Tensor:
        """Z (N, C, n, n), the first box's points (N, C, 8, 8), M (N, n, n) → z (N, C', n, n)."""
        count, _, n, _ = features.shape
        cells, grid = features.flatten(2).mT, points.flatten(2).mT
        matched = F.normalize(self.match(cells), dim=-1) @ F.normalize(self.match(grid), dim=-1).mT
        gate = self.gate(points[:, :, 1:-1, 1:-1].mean((2, 3)))
        seen = [4 * matched, torch.relu(self.belong(cells)) * gate[:, None], self.itself(cells)]
        peak = response.amax((1, 2), keepdim=True).clamp_min(0.05)
        planes = torch.stack([2 * response, response / peak], -1).flatten(1, 2)
        where = torch.from_numpy(np.stack([place(n, h).T for h in held.numpy()]))
        x = torch.relu(self.mix(torch.cat([*seen, planes, where], -1)))
        x = x.mT.reshape(count, -1, n, n)
        for conv in self.convs:
            x = x + torch.relu(conv(x))
        return x


class LinearF1(nn.Module):
    """The paper's f1: a 1×1 convolution to one channel."""

    def __init__(self, inputs: int = 256) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, 1, 1)

    def forward(self, features: Tensor) -> Tensor:
        """Z (N, C, n, n) → z (N, 1, n, n), eq. 4."""
        return self.conv(features.float())


class AttentionActor(nn.Module):
    """`entrack.policy.AttentionHead`: reads the box where z and m say that the target is."""

    def __init__(self, width: int, reach: float, n: int = 18) -> None:
        super().__init__()
        self.reach = reach
        self.head = nn.Linear(width, 9)
        self.beta = nn.Parameter(torch.tensor(6.0))
        nn.init.zeros_(self.head.weight)
        nn.init.zeros_(self.head.bias)
        with torch.no_grad():
            self.head.bias[5:] = -2.0
        along = (torch.arange(n) + 0.5) / n - 0.5
        self.register_buffer("x", along.repeat(n))
        self.register_buffer("y", along.repeat_interleave(n))
        self.register_buffer("outwards", torch.from_numpy(OUTWARDS))
        self.x: Tensor
        self.y: Tensor
        self.outwards: Tensor

    @property
    def features_size(self) -> int:
        """Length of what `features` gives to the critic."""
        return self.head.in_features + 14

    def _read(self, s: States) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Heat and attention (N, cells), z where it looks (N, C), offsets (N, 4), log σ (N, 4).

        Offsets are of the four sides, in box sizes.
        """
        z, (weight, bias) = s.z.flatten(2).float(), (self.head.weight, self.head.bias)
        # Written so that torch does not copy z, which is large: half of the time of an update.
        out = torch.bmm(weight[:5].expand(len(z), -1, -1), z) + bias[:5, None]
        heat = out[:, 0] + self.beta * s.m
        attention = torch.softmax(heat, 1)
        x, y = self.x / s.held[:, :1], self.y / s.held[:, 1:2]
        at = torch.stack([x, y, x, y], 1) + torch.exp(out[:, 1:]) * self.outwards[:, None]
        offset = torch.bmm(attention[:, None], at.mT)[:, 0] - self.outwards
        # The mean of a linear map is that of the mean.
        there = torch.bmm(attention[:, None], z.mT)[:, 0]
        return heat, attention, there, offset, there @ weight[5:].T + bias[5:]

    def forward(self, s: States) -> tuple[Tensor, Tensor, Tensor]:
        """μ and log σ before the tanh (N, 4), and the heat that the attention is made of."""
        heat, _, _, offset, log_std = self._read(s)
        mean = torch.atanh((offset / self.reach).clamp(-0.999, 0.999))
        return mean, log_std.clamp(*LOG_STD), heat

    def gaussian(self, s: States) -> tuple[Tensor, Tensor]:
        """μ and log σ before the tanh (N, 4)."""
        # Part by part, so that z, which a buffer keeps in half precision, is whole in the cache.
        parts = [self(s[k : k + PART])[:2] for k in range(0, len(s.m), PART)]
        mean, log_std = (torch.cat(part) for part in zip(*parts, strict=True))
        return mean, log_std

    @torch.no_grad()
    def features(self, s: States) -> Tensor:
        """What the critic sees of s: z and m where the policy looks, and what it would do."""
        _, attention, there, offset, log_std = self._read(s)
        m = (s.m * attention).sum(1)
        spread = -(attention * torch.log(attention + 1e-9)).sum(1)
        numbers = torch.stack([m, s.m.amax(1), spread, (s.held[:, 0] / s.held[:, 1]).log()], 1)
        return torch.cat([there, numbers, s.held[:, 2:], offset, log_std], 1)


class LinearActor(nn.Module):
    """The paper's actor (§3.2.8): f1, and linear layers μ(z), σ(m); or both of [z, m] (row 10)."""

    def __init__(
        self, reach: float, inputs: int = 256, cells: int = 324, joint: bool = False
    ) -> None:
        super().__init__()
        self.reach, self.joint = reach, joint
        self.f1 = LinearF1(inputs)
        pooled = 72 * 72
        self.mean = nn.Linear(cells + pooled if joint else cells, 4)
        self.log_std = nn.Linear(cells + pooled if joint else pooled, 4)
        self.features_size = cells + pooled

    def forward(self, s: States) -> tuple[Tensor, Tensor, Tensor]:
        """μ and log σ before the tanh (N, 4), and z."""
        z = self.f1(s.z).flatten(1)
        both = torch.cat([z, s.m], 1)
        mean = self.mean(both if self.joint else z)
        log_std = self.log_std(both if self.joint else s.m)
        return mean, log_std.clamp(*LOG_STD), z

    def gaussian(self, s: States) -> tuple[Tensor, Tensor]:
        """μ and log σ before the tanh (N, 4)."""
        return self(s)[:2]

    @torch.no_grad()
    def features(self, s: States) -> Tensor:
        """S = (z, m), eq. 6: 324 + 5184 numbers."""
        return torch.cat([self.f1(s.z).flatten(1), s.m], 1)


Actor = AttentionActor | LinearActor


def squashed(mean: Tensor, log_std: Tensor, reach: float, noise: Tensor) -> tuple[Tensor, Tensor]:
    """An action a = reach · tanh(μ + σ · noise) and log π(a | s), with the change of variables."""
    u = mean + log_std.exp() * noise
    gaussian = (-0.5 * noise.square() - log_std - 0.5 * math.log(2 * math.pi)).sum(-1)
    # log(1 − tanh² u) = 2 (log 2 − u − softplus(−2u)), which does not round to log 0.
    stretch = 2 * (math.log(2) - u - F.softplus(-2 * u)) + math.log(reach)
    return reach * torch.tanh(u), gaussian - stretch.sum(-1)


def perceptron(inputs: int, hidden: tuple[int, ...]) -> nn.Sequential:
    """A network with one output; without hidden layers it is the paper's single linear layer."""
    sizes = [inputs, *hidden]
    layers: list[nn.Module] = []
    for a, b in pairwise(sizes):
        layers += [nn.Linear(a, b), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(sizes[-1], 1), nn.Flatten(-2))


def weights_of(actor: Actor, f1: ConditionedF1 | None, basis: Basis | None) -> Weights:
    """Everything that `entrack.policy` reads, by its names there."""
    tensors: dict[str, Tensor] = {}
    if isinstance(actor, LinearActor):
        tensors = {
            f"{k}.{p}": t
            for k in ("mean", "log_std")
            for p, t in getattr(actor, k).named_parameters()
        }
        tensors["f1.weight"] = actor.f1.conv.weight.flatten(1)
        tensors["f1.bias"] = actor.f1.conv.bias  # type: ignore[assignment]
    else:
        assert f1 is not None and basis is not None
        tensors = {
            "head.weight": actor.head.weight,
            "head.bias": actor.head.bias,
            "head.beta": actor.beta,
        }
        for name in ("match", "belong", "gate", "itself"):
            layer: nn.Linear = getattr(f1, name)
            tensors[f"f1.{name}.weight"], tensors[f"f1.{name}.bias"] = basis.merged(
                layer.weight, layer.bias
            )
        tensors |= {"f1.mix.weight": f1.mix.weight, "f1.mix.bias": f1.mix.bias}
        for k, conv in enumerate(f1.convs):
            assert isinstance(conv, nn.Conv2d) and conv.bias is not None
            # `state._convolve` takes the nine shifts one after the other, all channels of each.
            tensors[f"f1.convs.{k}.weight"] = conv.weight.permute(0, 2, 3, 1).flatten(1)
            tensors[f"f1.convs.{k}.bias"] = conv.bias
    return {k: np.ascontiguousarray(t.detach().numpy()) for k, t in tensors.items()}


def as_states(
    arrays: Mapping[str, NDArray[np.generic]], rows: NDArray[np.intp] | None = None
) -> States:
    """A batch from numpy arrays, by the names of `States`; or of some rows. z may be in halves."""
    parts = [arrays[k] if rows is None else arrays[k][rows] for k in States._fields]
    return States(*(torch.from_numpy(part) for part in parts))
