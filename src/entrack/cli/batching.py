"""`entrack track --batch`: many clips under one progress bar."""

import json
import time
from collections.abc import Sequence
from contextlib import closing

import typer

from entrack.batch import Clip, run_clips
from entrack.cli.console import progress
from entrack.errors import EntrackError


def run_batch(
    clips: Sequence[Clip], workers: int | None, cluster: str | None, as_json: bool
) -> None:
    """Track what is not tracked yet, and print what was done."""
    todo = [clip for clip in clips if not clip.done()]
    began, frames, failed = time.perf_counter(), 0, dict[str, str]()
    with progress("clips", len(clips)) as advance:
        for _ in range(len(clips) - len(todo)):
            advance()
        with closing(run_clips(todo, workers, cluster)) as events:
            for event in events:
                name = todo[event.unit].name
                if event.kind == "again":
                    typer.echo(f"{name}: its worker died, trying again", err=True)
                elif event.kind == "failed":
                    failed[name] = event.value.splitlines()[0]
                    typer.echo(f"{name} failed: {failed[name]}", err=True)
                elif event.kind == "done":
                    frames += event.value
                if event.kind in ("done", "failed"):
                    advance()
    seconds = time.perf_counter() - began
    done = len(todo) - len(failed)
    if as_json:
        counts = {"clips": done, "before": len(clips) - len(todo), "frames": frames}
        times = {"seconds": round(seconds, 3), "fps": round(frames / seconds, 2)}
        typer.echo(json.dumps({**counts, **times, "failed": failed}))
    else:
        typer.echo(
            f"{done} clips, {frames} frames in {seconds:.1f} s, {frames / seconds:.1f} frames/s; "
            f"{len(clips) - len(todo)} were done before, {len(failed)} failed"
        )
    if failed:
        first = next(clip for clip in todo if clip.name in failed)
        raise EntrackError(f"{len(failed)} clips failed, such as {first.name}: see {first.failed}")
