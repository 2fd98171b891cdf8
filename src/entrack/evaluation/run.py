"""A run: trackers on datasets, in worker processes, scored under protocols, in one folder.

OUT/scores.json                              a row a dataset, protocol and tracker
OUT/<dataset>/dataset.json                   what was there and what was not
OUT/<dataset>/<tracker>/run.json             checksum, version, machine, threads
OUT/<dataset>/<tracker>/<sequence>.txt       boxes; <sequence>.time.txt: seconds
OUT/<dataset>/<tracker>/<sequence>.score.csv what the tracker said of itself, if it did
OUT/<dataset>/<tracker>/baseline/…           VOT's files, for supervised runs
OUT/<dataset>/<tracker>/<sequence>.failed.txt
OUT/<dataset>/<tracker>/scores/<protocol>.json   curves, every sequence's numbers
    OUT/export/<layout>/<dataset>/<tracker>/         results as other toolkits write them
"""

from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from entrack.errors import EntrackError
from entrack.evaluation import record, request
from entrack.evaluation.cluster import run_on_cluster
from entrack.evaluation.export import check_layouts, export
from entrack.evaluation.pool import Event, run_units
from entrack.evaluation.raw import Results
from entrack.evaluation.request import Entry
from entrack.evaluation.score import Row, score
from entrack.evaluation.unit import Unit, run_unit
from entrack.files import write_bytes, writing
from entrack.model import SHIPPED
from entrack.peers import parse_all


class Watcher:
    """Hears how far a run is; this one does not listen."""

    def plan(self, frames: int) -> None:
        """Hear how many frames are to be tracked."""

    def frames(self, done: int) -> None:
        """Hear how many of them are done by now."""

    def say(self, message: str) -> None:
        """Hear what a person should know."""


@dataclass(frozen=True)
class Options:
    """How to run and score.

    Parameters
    ----------
    protocols
        Names of protocols; empty: the usual one of each dataset.
    workers
        Processes; None: one, or all that the cluster has room for.
    threads
        Threads of each: one by default, for one worker as for many, so that numbers do not depend
        on how many there are, and two do twice the work of one.
    allow_partial
        Score results of another length than the ground truth, and of some of the sequences.
    export
        Layouts in which results are written a second time, below `OUT/export`.
    cluster
        Address of a Ray cluster, "auto" or "local"; see `entrack.evaluation.cluster`.
    """

    protocols: tuple[str, ...] = ()
    workers: int | None = None
    threads: int = 1
    allow_partial: bool = False
    export: tuple[str, ...] = ()
    cluster: str | None = None


@dataclass
class Outcome:
    """Rows of a run, and by "dataset/tracker/sequence" why a unit failed."""

    rows: list[Row] = field(default_factory=list[Row])
    failed: dict[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True)
class Evaluation:
    """A run that has been checked: everything that it needs is there and fits together."""

    entries: list[Entry]
    out: Path
    options: Options
    given: list[Row]
    """Rows of results that existed; they are scored at once, so that errors come at once."""
    notes: list[str]
    """What a person should know of the datasets."""

    @classmethod
    def prepare(
        cls, data: list[str], trackers: list[str], out: Path, options: Options | None = None
    ) -> "Evaluation":
        """Open datasets and trackers, and score given results.

        Parameters
        ----------
        data
            Datasets as `FORMAT:DIR` or `NAME=FORMAT:DIR`.
        trackers
            Trackers as `entrack.peers.parse` reads them.
        out
            The run's folder.

        Raises
        ------
        EntrackError
            If a dataset, tracker, protocol or given result cannot be used.
        """
        options = options or Options()
        contenders = parse_all(trackers)
        ours = [c for c in contenders if c.kind != "raw"]
        for contender in ours:
            contender.make(options.threads)
        entries = request.entries(data, contenders, options.protocols, out)
        truths = {entry.truth.name: entry.truth for entry in entries}.values()
        for truth in truths:
            check_layouts(truth, options.export)
        notes = [note for truth in truths for note in record.describe_dataset(truth, out)]
        given: list[Row] = []
        for entry in entries:
            if entry.contender.kind != "raw":
                record.check_same_tracker(entry, options.threads)
                continue
            if not options.allow_partial:
                _check_complete(entry)
            given += _score(entry, options, {})
        return cls([e for e in entries if e.contender in ours], out, options, given, notes)

    def run(self, watcher: Watcher | None = None) -> Outcome:
        """Track what is not tracked yet, and score everything."""
        watcher, outcome = watcher or Watcher(), Outcome(list(self.given))
        for note in self.notes:
            watcher.say(note)
        try:
            _track(self.entries, self.options, watcher, outcome)
        finally:
            # A run that is stopped says how far it has come.
            for entry in self.entries:
                outcome.rows += _score(entry, self.options, outcome.failed)
            record.merge_rows(self.out / "scores.json", outcome.rows)
        return outcome


def _check_complete(entry: Entry) -> None:
    results = Results(entry.results)
    missing = [s.name for s in entry.truth.sequences if not results.files(s.name)]
    if missing:
        raise EntrackError(
            f"{entry.results} has no results for {len(missing)} of {len(entry.truth.sequences)} "
            f"sequences of {entry.truth.name}: {', '.join(missing[:5])}"
            f"{', …' if len(missing) > 5 else ''}; --allow-partial scores the others"
        )


def _track(entries: list[Entry], options: Options, watcher: Watcher, outcome: Outcome) -> None:
    """Do what is not done yet, the longest first, so that no worker is left with it at the end."""
    todo = [
        (unit, len(sequence), entry)
        for entry in entries
        for unit, sequence in entry.units(options.threads)
        if not unit.done(len(sequence))
    ]
    todo.sort(key=lambda item: -item[0].work(item[1]))
    if not todo:
        return
    works = [unit.work(frames) for unit, frames, _ in todo]
    watcher.plan(sum(works))
    done = [0] * len(todo)
    with closing(_events([unit for unit, _, _ in todo], options)) as events:
        for event in events:
            unit, frames, entry = todo[event.unit]
            label, why = f"{entry.label}/{unit.sequence}", None
            if event.kind == "progress":
                done[event.unit] = min(event.value, works[event.unit])
            elif event.kind == "again":
                done[event.unit] = 0
                watcher.say(f"{label}: its worker died, trying again")
            else:
                done[event.unit] = works[event.unit]
                unit.failed.unlink(missing_ok=True)
                if event.kind == "failed":
                    why = event.value
                elif options.cluster and not unit.done(frames):
                    why = f"its results are not in {entry.folder}: do all machines see this folder?"
            if why is not None:
                _fail(unit, why)
                outcome.failed[label] = why.splitlines()[0]
                watcher.say(f"{label} failed: {outcome.failed[label]}")
            watcher.frames(sum(done))


def _events(units: list[Unit], options: Options) -> Generator[Event]:
    """Run the units where they are to run."""
    if options.cluster is None:
        return run_units(run_unit, units, options.workers or 1, options.threads)
    units = [unit.anywhere() for unit in units]
    contenders = [unit.contender for unit in units if unit.contender.kind == "model"]
    models = sorted({c.spec for c in contenders} - set(SHIPPED))
    return run_on_cluster(
        run_unit, units, options.cluster, options.workers, options.threads, models
    )


def _fail(unit: Unit, why: str) -> None:
    with writing(unit.folder):
        unit.folder.mkdir(parents=True, exist_ok=True)
    write_bytes(unit.failed, f"{why}\n".encode())


def _score(entry: Entry, options: Options, failed: dict[str, str]) -> list[Row]:
    """Rows of an entry, one a protocol; none if it has no result at all."""
    start = f"{entry.label}/"
    ours = {name[len(start) :]: why for name, why in failed.items() if name.startswith(start)}
    results, rows = Results(entry.results), list[Row]()
    for layout in options.export:
        place = entry.out / "export" / layout / entry.truth.name / entry.contender.folder
        export(entry.truth, results, layout, place)
    for protocol in entry.protocols:
        scored = score(entry.truth, results, protocol, allow_partial=options.allow_partial)
        if scored.scores:
            rows.append(record.write_scores(entry, scored, ours))
    return rows
