"""`entrack train`."""

from pathlib import Path
from typing import Annotated

import typer

from entrack.cli.console import CUTOUTS, STILLS, checking_call, new_app, stages
from entrack.errors import require
from entrack.files import writing

app = new_app()


@app.command()
def train(
    data: Annotated[
        list[str], typer.Option(metavar="FORMAT:DIR", help="Annotated clips; may be repeated.")
    ],
    out: Annotated[Path, typer.Option(metavar="RUN", help="Folder of the run.")],
    config: Annotated[
        str, typer.Option(metavar="paper|default|FILE.toml", help="What is trained, and how.")
    ] = "default",
    model: Annotated[
        str, typer.Option(metavar="MODEL", help="Whose trunk the new model gets.")
    ] = "cf",
    stills: Annotated[Path | None, STILLS] = None,
    cutouts: Annotated[Path | None, CUTOUTS] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the configuration's.")] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Processes that play episodes: two by default; on a cluster, all it has room for.",
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="auto|local|ADDRESS",
            help="Play on Ray, on machines that all see RUN: a cluster's address, or this machine.",
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on where RUN was stopped.")] = False,
) -> None:
    """Train a policy by maximum-entropy reinforcement learning.

    \b
    entrack train --data folder:clips --stills pictures --out runs/mine
    entrack train --config paper --data got10k:GOT-10k/train --model models/paper --out runs/paper
    entrack track video.mp4 --box 10,20,40,80 --model runs/mine/model

    RUN keeps the state, the curves (CSV and TensorBoard), and in the end model/. Ctrl-C stops; the
    same call with --resume goes on.
    """  # noqa: D301
    require("torch", "train")
    from dataclasses import replace

    from entrack.learn.train import Source, Training, preset, shortened
    from entrack.model import load_model

    with checking_call():
        settings = preset(config)
        if seed is not None:
            settings = replace(settings, seed=seed)
        base = load_model(model)
    source = Source(tuple(data), stills, cutouts)
    try:
        with writing(out), stages() as report:
            training = Training(settings, base, source, out, workers, resume, report, cluster)
            training.gather()
        told = dict(training.failed)
        if told:  # now, not hours later
            typer.echo(f"left out: {shortened(told)}", err=True)
        with writing(out), stages() as training.report:
            folder = training()
    except KeyboardInterrupt:
        typer.echo(
            f"stopped: the same call with --resume goes on from the last checkpoint in {out}",
            err=True,
        )
        raise
    if later := {name: why for name, why in training.failed.items() if told.get(name) != why}:
        typer.echo(f"left out: {shortened(later)}", err=True)
    typer.echo(folder)
