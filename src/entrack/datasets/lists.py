"""The benchmarks' official lists, which are data files beside this module."""

import json
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple


class Target(NamedTuple):
    """One target of a benchmark in which several may share a folder."""

    folder: str
    first: int
    last: int
    truth: str
    skip: int = 0
    """Rows of the ground truth before the first frame."""

    @property
    def frames(self) -> int:
        """Number of frames from the first to the last."""
        return self.last - self.first + 1


@cache
def _load(name: str) -> Any:
    return json.loads((files("entrack.datasets") / "data" / name).read_text("utf-8"))


@cache
def otb() -> dict[str, Target]:
    """The 100 targets of OTB-100."""
    defaults = {"truth": "groundtruth_rect.txt"}
    listed = _load("otb100.json")["targets"]
    return {name: Target(**{"folder": name} | defaults | row) for name, row in listed.items()}


def aliases(name: str) -> tuple[str, ...]:
    """Other names under which toolkits file the results of a sequence."""
    return tuple(_load("otb100.json")["aliases"].get(name, ()))


@cache
def uav123() -> dict[str, Target]:
    """The 123 targets of UAV123 at 30 frames a second."""
    listed = _load("uav123.json")["targets"]
    return {name: Target(**row, truth=f"{name}.txt") for name, row in listed.items()}


@cache
def uav123_10fps() -> dict[str, Target]:
    """The 123 targets of UAV123@10fps: every third picture, numbered anew."""
    return {
        name: t._replace(first=(t.first - 1) // 3 + 1, last=(t.last - 1) // 3 + 1)
        for name, t in uav123().items()
    }


def lasot_test() -> tuple[str, ...]:
    """The 280 test videos of LaSOT."""
    return tuple(f"{c}-{n}" for c, numbers in _load("lasot.json")["test"].items() for n in numbers)


def lasot_train() -> tuple[str, ...]:
    """The 1120 training videos of LaSOT: the others of each class's twenty."""
    test = set(lasot_test())
    every = (f"{c}-{n}" for c in _load("lasot.json")["test"] for n in range(1, 21))
    return tuple(name for name in every if name not in test)


def lasot_attributes() -> tuple[str, ...]:
    """Names of LaSOT's 14 attributes, in the order of its files and of the paper's Table 2."""
    return tuple(_load("lasot.json")["attributes"])


def longer_results() -> frozenset[str]:
    """Sequences whose published results are longer than the ground truth, and are cut to it."""
    return frozenset(_load("lasot.json")["longer_results"])


VOT_YEARS = ("vot2016", "vot2018", "vot2019")


def vot(year: str) -> tuple[str, ...]:
    """The 60 sequences of "vot2016", "vot2018" or "vot2019"."""
    return tuple(_load("vot.json")["sequences"][year])


def sources() -> dict[str, str]:
    """Where each list comes from."""
    names = ("otb100", "uav123", "lasot", "vot")
    return {name: _load(f"{name}.json")["source"] for name in names}
