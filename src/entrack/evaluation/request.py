"""What was asked for: datasets, protocols and trackers that fit together, or one clear error."""

import re
from dataclasses import dataclass
from pathlib import Path

from entrack.datasets import Sequence, open_dataset
from entrack.errors import EntrackError
from entrack.evaluation.protocol import Protocol
from entrack.evaluation.protocols import default_protocol, find_protocol
from entrack.evaluation.score import Truth
from entrack.evaluation.unit import Unit
from entrack.peers import Contender


@dataclass(frozen=True)
class Entry:
    """One tracker on one dataset, in a run's folder."""

    truth: Truth
    spec: str
    """The dataset as `open_dataset` takes it."""
    protocols: tuple[Protocol, ...]
    contender: Contender
    out: Path

    @property
    def folder(self) -> Path:
        """Where what belongs to this entry is written."""
        return self.out / self.truth.name / self.contender.folder

    @property
    def results(self) -> Path:
        """Where the results are: given ones stay where they are."""
        return self.contender.results if self.contender.kind == "raw" else self.folder

    @property
    def label(self) -> str:
        """Name of the entry in messages."""
        return f"{self.truth.name}/{self.contender.name}"

    def units(self, threads: int) -> list[tuple[Unit, Sequence]]:
        """Every sequence as a unit of work."""
        judges = [protocol.toolkit for protocol in self.protocols if protocol.supervised]
        supervised, toolkit = bool(judges), bool(judges) and all(judges)
        return [
            (Unit(self.spec, s.name, self.contender, self.folder, supervised, threads, toolkit), s)
            for s in self.truth.sequences
        ]


def entries(
    data: list[str], contenders: list[Contender], protocols: tuple[str, ...], out: Path
) -> list[Entry]:
    """Pair every dataset with every tracker.

    Raises
    ------
    EntrackError
        For a dataset that cannot be opened, two of one name, or a protocol that fits none.
    """
    opened = _open(data)
    chosen = {t.name: _fitting(t, protocols) for t, _ in opened}
    used = {p.name for fitting in chosen.values() for p in fitting}
    for name in protocols:
        if name not in used:
            find_protocol(name, opened[0][0].dataset.format)
    return [Entry(t, spec, chosen[t.name], c, out) for t, spec in opened for c in contenders]


def _open(data: list[str]) -> list[tuple[Truth, str]]:
    opened: dict[str, tuple[Truth, str]] = {}
    for text in data:
        named = re.fullmatch(r"([\w.+-]+)=(.+)", text, re.DOTALL)
        spec = named[2] if named else text
        name = named[1] if named else spec.partition(":")[0]
        if name in opened:
            other = opened[name][1]
            raise EntrackError(
                f"two datasets are called {name}: {other} and {spec}; "
                "name one of them, NAME=FORMAT:DIR"
            )
        opened[name] = (Truth.read(name, open_dataset(spec)), spec)
    return list(opened.values())


def _fitting(truth: Truth, names: tuple[str, ...]) -> tuple[Protocol, ...]:
    """Those of the protocols that fit a dataset, or its usual one; there must be one."""
    form = truth.dataset.format
    if not names:
        return (find_protocol(default_protocol(form), form),)
    fitting: list[Protocol] = []
    problem: EntrackError | None = None
    for name in names:
        try:
            fitting.append(find_protocol(name, form))
        except EntrackError as error:
            problem = error
    if problem and not fitting:
        raise problem
    return tuple(fitting)
