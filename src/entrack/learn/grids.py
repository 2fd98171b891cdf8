"""The ablations of `entrack ablate` (§4.4): each a list of cells, each cell a few keys of a run.

A cell changes only what it names; everything else is the base configuration's.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from entrack.config import parse
from entrack.errors import EntrackError
from entrack.learn.config import TrainConfig

Changes = Mapping[str, Any]
"""Key of the configuration, with dots → value."""


@dataclass(frozen=True)
class Grid:
    """What is varied, and what the others are compared with."""

    title: str
    reference: str
    """The cell that the paper chose."""
    cells: Mapping[str, Changes]
    published: Mapping[str, float] = field(default_factory=dict[str, float])
    """AUC that the paper prints for cells, on OTB100."""


def _alpha(value: float) -> Changes:
    return {"sac.alpha": value, "sac.alpha_auto": False}


_TABLE_4 = {0.0: 0.61, 0.1: 0.62, 0.2: 0.655, 0.3: 0.645, 0.5: 0.637, 0.7: 0.623, 0.9: 0.619}

GRIDS: dict[str, Grid] = {
    "alpha": Grid(
        "Weight of the entropy, α (Table 4)",
        "0.2",
        {f"{a:g}": _alpha(a) for a in _TABLE_4},
        {f"{a:g}": auc for a, auc in _TABLE_4.items()},
    ),
    "critic": Grid(
        "Hidden layers of Q and V",
        "linear",
        {
            "linear": {"sac.hidden": ()},
            "64": {"sac.hidden": (64,)},
            "128-128": {"sac.hidden": (128, 128)},
        },
    ),
    "inputs": Grid(
        "What the policy sees",
        "μ(z), σ(m)",
        {
            "μ(z), σ(m)": {"joint": False, "tracker.policy.f1": "linear", "warm": None},
            "[z, m]": {"joint": True, "tracker.policy.f1": "linear", "warm": None},
            "compared with the first frame": {"tracker.policy.f1": "conditioned"},
        },
    ),
    "warmstart": Grid(
        "Behaviour cloning before soft actor-critic",
        "none",
        {"none": {"warm": None}, "warm, then SAC": {}, "warm only": {"rounds": 0}},
    ),
    "template": Grid(
        "The template in training",
        "oracle",
        {
            "oracle": {"episode.oracle": 1.0},
            "half of the episodes": {"episode.oracle": 0.5},
            "running mean": {"episode.oracle": 0.0},
        },
    ),
    "termination": Grid(
        "When an episode ends, and what missing costs",
        "first miss, −1",
        {
            "first miss, −1": {"episode.patience": 1, "episode.tau": 0.5, "episode.miss": -1.0},
            "first miss, IoU": {"episode.patience": 1, "episode.tau": 0.0, "episode.miss": 0.0},
            "five misses, −1": {"episode.patience": 5, "episode.tau": 0.5, "episode.miss": -1.0},
            "five misses, IoU": {"episode.patience": 5, "episode.tau": 0.0, "episode.miss": 0.0},
        },
    ),
    "changes": Grid(
        "One change at a time",
        "as configured",
        {
            "as configured": {},
            "no training": {"rounds": 0},
            "critic of two layers": {"sac.hidden": (64, 64)},
            "μ and σ of [z, m]": {"joint": True},
            "reward is the IoU": {"episode.tau": 0.0, "episode.miss": 0.0},
            "buffer is kept": {"fresh": False},
            "short clips, jittered": {
                "episode.whole": False, "episode.frames": (32, 64), "episode.jitter": 0.05,
            },
            "warm start": {"warm": {}, "bank.looks": 10_000},
            "warm start alone": {"warm": {}, "bank.looks": 10_000, "rounds": 0},
            "imitation": {"sac.imitate": 2.0},
            "imitation, [z, m]": {"sac.imitate": 2.0, "joint": True},
        },
    ),
}  # fmt: skip


def changed(config: TrainConfig, changes: Changes) -> TrainConfig:
    """The configuration with some keys replaced; checked like any other."""
    values = asdict(config)
    for key, value in changes.items():
        *path, last = key.split(".")
        place = values
        for part in path:
            place = place[part]
        place[last] = value
    return parse(TrainConfig, values, "the cell")


def scaled(config: TrainConfig, scale: float) -> TrainConfig:
    """The configuration with `scale` times the rounds, looks, warm steps and made clips."""

    def times(count: int, least: int) -> int:
        return max(least, round(scale * count)) if count else 0

    changes: dict[str, Any] = {
        "rounds": times(config.rounds, 1),
        "bank.looks": times(config.bank.looks, 500),
        "data.made": times(config.data.made, 2),
    }
    if config.warm:
        changes["warm.steps"] = times(config.warm.steps, 10)
    return changed(config, changes)


def cells(name: str, config: TrainConfig) -> dict[str, TrainConfig]:
    """The configurations of a grid's cells, without any that is the same as one before it.

    Raises
    ------
    EntrackError
        If there is no such grid, or the base configuration has no warm start to leave out.
    """
    if name not in GRIDS:
        raise EntrackError(f"no ablation {name}: there are {', '.join(GRIDS)}")
    if name == "warmstart" and config.warm is None:
        raise EntrackError(
            f"the configuration {config.name} has no [warm]: its warm start cannot be ablated"
        )
    made: dict[str, TrainConfig] = {}
    for cell, changes in GRIDS[name].cells.items():
        other = changed(config, changes)
        if other not in made.values():
            made[cell] = other
    return made
