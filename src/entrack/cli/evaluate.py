"""`entrack evaluate`."""

import json
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from entrack.cli.console import checking_call, new_app
from entrack.cli.many import ManyValues
from entrack.errors import EntrackError
from entrack.evaluation.run import Evaluation, Options, Watcher

app = new_app()


@app.command(cls=ManyValues)
def evaluate(
    data: Annotated[
        list[str],
        typer.Option(
            metavar="[NAME=]FORMAT:DIR...",
            help="Datasets: otb, uav123, lasot, vot2016, vot2018, vot2019, got10k, folder or "
            "synthetic, and where they are; synthetic:hard is made on the way.",
        ),
    ],
    tracker: Annotated[
        list[str],
        typer.Option(
            metavar="[NAME=]TRACKER...",
            help="Trackers: default, cf, a model folder, opencv:csrt|kcf|mosse|mil|…, "
            "opencv:nano:DIR, module:Class, or raw:DIR for results that exist.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the run.")],
    protocol: Annotated[
        list[str] | None,
        typer.Option(
            metavar="P...",
            help="otb, uav123, lasot, got10k, longterm, vot2016, vot2018, vot2019 or vot-toolkit; "
            "by default each dataset's own.",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes: one by default; on a cluster, all it has room for."),
    ] = None,
    threads: Annotated[int, typer.Option(min=1, help="Threads of each process.")] = 1,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="auto|local|ADDRESS",
            help="Run on Ray: a cluster's address, or this machine's own.",
        ),
    ] = None,
    allow_partial: Annotated[
        bool,
        typer.Option(
            "--allow-partial", help="Score results of another length, or of some sequences only."
        ),
    ] = False,
    export: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LAYOUT...",
            help="Write results also as otb, got10k, pysot, pytracking, vot or vot-binary.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON.")] = False,
) -> None:
    """Run trackers on benchmarks and score them as the official toolkits do.

    \b
    entrack evaluate --data otb:OTB100 --tracker default opencv:csrt --out run --workers 2
    entrack evaluate --data otb:OTB100 lasot:LaSOT --tracker raw:results/ATOM --out run
    entrack evaluate --data vot2018:VOT2018 --tracker cf --protocol vot2018 vot-toolkit --out run
    entrack evaluate --data synthetic:hard --tracker cf --protocol longterm --out run
    entrack evaluate --data otb:/nfs/OTB100 --tracker cf --out /nfs/run --cluster HOST:6379

    What is done is not done again: stop it with Ctrl-C, and call it again. A sequence on which a
    tracker fails is marked, and the others go on.
    """  # noqa: D301
    protocols, layouts = tuple(protocol or ()), tuple(export or ())
    options = Options(protocols, workers, threads, allow_partial, layouts, cluster)
    with checking_call():
        evaluation = Evaluation.prepare(data, tracker, out, options)
    with _watching() as watcher:
        outcome = evaluation.run(watcher)
    typer.echo(json.dumps(outcome.rows, indent=1) if as_json else _table(outcome.rows))
    if outcome.failed:
        raise EntrackError(
            f"{len(outcome.failed)} sequences failed, see *.failed.txt in {out}: "
            f"{next(iter(outcome.failed))}"
        )


_NUMBERS = (
    *("auc", "precision", "norm_precision", "op50", "ao", "accuracy", "robustness", "eao"),
    *("f_score", "tracking_precision", "tracking_recall", "roc_auc", "ece", "coverage", "refound"),
)


def _table(rows: list[dict[str, Any]]) -> str:
    """Rows as aligned text, with the columns that one of them has."""
    numbers = [n for n in (*_NUMBERS, "fps_mean") if any(row.get(n) is not None for row in rows)]
    lines = [["dataset", "protocol", "tracker", "sequences", *numbers]]
    for row in rows:
        scored = f"{row['sequences']}/{row['official'] or row['available']}"
        values = [_format(row.get(name), 1 if name == "fps_mean" else 4) for name in numbers]
        lines.append([row["dataset"], row["protocol"], row["tracker"], scored, *values])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(word.ljust(width) for word, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def _format(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


@contextmanager
def _watching() -> Generator[Watcher]:
    """Show a bar of frames on stderr, with rate and time left, once there is something to do."""
    from rich import progress
    from rich.console import Console
    from rich.text import Text

    class Rate(progress.ProgressColumn):
        def render(self, task: progress.Task) -> Text:
            return Text("" if task.speed is None else f"{task.speed:.0f} frames/s")

    console = Console(stderr=True)
    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        Rate(),
        progress.TimeRemainingColumn(elapsed_when_finished=True),
    )
    bar = progress.Progress(*columns, console=console)

    class Bar(Watcher):
        def plan(self, frames: int) -> None:
            bar.add_task("tracking", total=frames)
            bar.start()

        def frames(self, done: int) -> None:
            bar.update(bar.task_ids[0], completed=done)

        def say(self, message: str) -> None:
            console.print(message, markup=False, highlight=False, soft_wrap=True)

    try:
        yield Bar()
    finally:
        if bar.tasks:
            bar.stop()
