"""Track through hundreds of damaged videos: a result or one clear sentence, and nothing lost.

    python -m reliability.faults [--rounds 2]

Each file is made, tracked by `entrack track` (with a trunk that costs nothing), opened as the web
page opens it, and deleted. It fails if the program crashes, takes longer than 30 s, says anything
but one line, or if the frames before the fault are not on disk; a good file must be tracked to its
end.
"""

import contextlib
import io
import json
import re
import resource
import signal
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import entrack
from entrack import EntrackError
from entrack.config import Config, WindowConfig
from entrack.evaluation.pool import run_units
from entrack.tracker import Tracker
from entrack.video import Clip
from reliability.corpus import FRAMES, GOOD, corpus
from reliability.figures import parser, tell
from reliability.targets import Means

SECONDS = 30


def look(path: Path, report: Any = None) -> tuple[str, list[str], int]:
    """Track one file; return how it ended, what was wrong, and the peak of memory in MB."""
    signal.alarm(2 * SECONDS)  # kills the worker, which is noticed
    ended, wrong = _track(path)
    try:
        with Clip(path) as clip, contextlib.suppress(IndexError):
            for index in range(len(clip)):
                clip[index]
    except EntrackError as error:
        if "\n" in str(error):
            wrong.append(f"Clip says more than a sentence: {error}")
    signal.alarm(0)
    return ended, wrong, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000


def _track(path: Path) -> tuple[str, list[str]]:
    from entrack.cli.app import main

    entrack.load = lambda *_, **__: Tracker(Config(window=WindowConfig(size=64)), Means())
    with tempfile.TemporaryDirectory() as place:
        table = Path(place) / "boxes.csv"
        call = ["track", str(path), "--box", "4,4,8,8", "--boxes", str(table), "--json"]
        if path.stem.endswith("0"):
            call += ["--video", f"{place}/out.mp4"]
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(call)
        rows = table.read_text().count("\n") - 1 if table.exists() else 0
        said = [line for line in err.getvalue().splitlines() if line.startswith("error: ")]
        left = [p.name for p in Path(place).iterdir() if p.name not in ("boxes.csv", "out.mp4")]
    wrong = [f"left behind {left}"] if left else []
    if code == 0:
        done = json.loads(out.getvalue())
        if rows != done["frames"] or not rows:
            wrong.append(f"{done['frames']} frames, {rows} rows on disk")
    elif len(said) != 1 or "Traceback" in err.getvalue():
        wrong.append(f"code {code}, said {err.getvalue()[-400:]!r}")
    else:
        broke = re.search(r"breaks off at frame (\d+)", said[0])
        if broke and int(broke[1]) != rows:
            wrong.append(f"{rows} rows on disk, but: {said[0]}")
    name, _, fault = path.stem.partition(".")
    good = GOOD.get(name)
    if good and not fault and (code or rows != good.frames):
        wrong.append(f"a good file: {rows} of {FRAMES} frames, {said}")
    if code == 0:
        return "whole", wrong
    return ("partial" if rows else "refused"), wrong


def faults(rounds: int) -> tuple[dict[str, Any], list[str]]:
    """Make and track the corpus; return figures and what was not as promised."""
    ends, broken, peak = Counter[str](), list[str](), 0
    with tempfile.TemporaryDirectory() as place:
        files = list(corpus(Path(place), rounds))
        for event in run_units(look, files, 1):
            file = files[event.unit].name
            if event.kind == "done":
                ended, wrong, memory = event.value
                ends[ended] += 1
                peak = max(peak, memory)
                broken += [f"{file}: {sentence}" for sentence in wrong]
            elif event.kind in ("failed", "again"):
                ends["crashed"] += event.kind == "failed"
                broken.append(f"{file}: {event.value or 'its worker died'}")
            if event.kind in ("done", "failed"):
                files[event.unit].unlink(missing_ok=True)
    figures = {
        "files": len(files),
        **{end: ends[end] for end in ("whole", "partial", "refused", "crashed")},
        "peak_mb": peak,
    }
    return figures, broken


def main() -> int:
    """Run from the command line."""
    words = parser(__doc__)
    words.add_argument("--rounds", type=int, default=2)
    given = words.parse_args()
    return tell("faults", *faults(given.rounds), given.out)


if __name__ == "__main__":
    sys.exit(main())
