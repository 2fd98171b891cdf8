"""`entrack bench`."""

import json
import os
from pathlib import Path
from typing import Annotated, Any

import typer

from entrack.cli.console import checking_call, new_app
from entrack.files import write_bytes

app = new_app()

PEERS = ("opencv:csrt", "opencv:kcf", "opencv:mosse", "opencv:medianflow")
"""Trackers of OpenCV that need no file."""


@app.command()
def bench(
    model: Annotated[str, typer.Option(help="Name of a model, or its folder.")] = "cf",
    peers: Annotated[bool, typer.Option("--peers", help="Time OpenCV's trackers as well.")] = False,
    nanotrack: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Time NanoTrack as well, with its networks in DIR."),
    ] = None,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Threads of every engine; all cores by default.")
    ] = None,
    frames: Annotated[int, typer.Option(min=10, help="Frames of the demo clip to track.")] = 40,
    out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write everything here as JSON.")
    ] = None,
) -> None:
    """Measure how fast this machine tracks, on the demo clip in memory (640×360).

    \b
    entrack bench
    entrack bench --peers --json bench.json
    entrack bench --peers --nanotrack models/nanotrack --threads 2

    Everything that is compared takes turns, so ratios hold on a busy machine too; milliseconds are
    medians.
    """  # noqa: D301
    from entrack import bench as b
    from entrack.model import load_model
    from entrack.trunk import load_trunk

    threads = threads or os.cpu_count() or 1
    others = list(PEERS) if peers else []
    others += [f"opencv:nano:{nanotrack}"] if nanotrack else []
    with checking_call():
        opened = load_model(model)
        contenders = b.contenders(opened, threads, others)
    recording = b.demo(frames)
    trunk = load_trunk(opened.trunk, threads=threads)
    found: dict[str, Any] = {
        "machine": b.machine(threads),
        "model": {"name": opened.name, "sha256": opened.checksum, "precision": trunk.precision},
        "stages": {
            sizes: _summaries(b.stages(b.with_sizes(opened.config, sizes), trunk, recording))
            for sizes in (1, 3)
        },
        "engines": {
            name: _summaries(times) for name, times in b.engines(opened.trunk, threads).items()
        },
        "trackers": _summaries(b.trackers(contenders, recording)),
    }
    _print(found)
    if out:
        write_bytes(out, json.dumps(found, indent=1).encode())


def _summaries(times: dict[str, list[float]]) -> dict[str, dict[str, float]]:
    from entrack.bench import summary

    return {name: summary(values) for name, values in times.items()}


def _print(found: dict[str, Any]) -> None:
    """Show three tables: stages of a frame, engines, trackers."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    machine, model = found["machine"], found["model"]
    console.print(
        f"{machine['cpu']}, {machine['threads']} of {machine['cores']} threads; "
        f"model {model['name']} in {model['precision']}",
        highlight=False,
    )

    table = Table("stage of a frame, ms", "one size", "three sizes")
    one, three = found["stages"].values()
    for stage in one:
        label = "all but decoding" if stage == "frame" else stage
        table.add_row(label, *(f"{sizes[stage]['ms']:.2f}" for sizes in (one, three)))
    console.print(table)

    table = Table("trunk, ms", "one patch", "four at a time")
    for engine, times in found["engines"].items():
        table.add_row(engine, *(f"{times[count]['ms']:.2f}" for count in ("1", "4")))
    console.print(table)

    table = Table("tracker", "ms", "frames/s", "times as fast")
    slowest = max(times["ms"] for times in found["trackers"].values())
    for name, times in found["trackers"].items():
        ratio = f"{slowest / times['ms']:.1f}"
        table.add_row(name, f"{times['ms']:.2f}", f"{times['fps']:.0f}", ratio)
    console.print(table)
