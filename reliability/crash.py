"""Kill commands at random moments: a plain second call has to end as if nothing had happened.

    python -m reliability.crash [--kills 50] [--only evaluate track]

Each command runs once undisturbed. Then it is started and killed with SIGKILL, it and all its
workers' parent, again and again in one folder, until a call comes to its end; the folder must then
hold the same results. Then the folder is emptied and it begins anew, until it was killed so often.
"""

import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from entrack.model import assets
from reliability.figures import parser, tell

_CLIP = str(assets() / "demo" / "clip.mp4")


class Command(NamedTuple):
    """A command line that writes to a folder, and which files of that have to be equal."""

    words: Callable[[Path, Path], list[str]]
    """Of the folder with material and the folder to write to."""
    results: tuple[str, ...]


COMMANDS: dict[str, Command] = {
    "track": Command(
        lambda data, out: ["track", _CLIP, "--box", "148,153,102,94", "--stop", "40",
                           "--boxes", f"{out}/b.txt", "--video", f"{out}/v.mp4"],
        ("b.txt",),
    ),
    "evaluate": Command(
        lambda data, out: ["evaluate", "--data", f"folder:{data}", "--tracker", "cf", "opencv:kcf",
                           "--workers", "2", "--out", str(out)],
        ("folder/*/*.txt",),
    ),
}  # fmt: skip


def _material(folder: Path) -> Path:
    """Three annotated clips of a few frames."""
    from reliability.corpus import GOOD, write

    for name in ("a", "b", "c"):
        write(folder / f"{name}.mp4", GOOD["mp4"])
        (folder / f"{name}.txt").write_text("24,18,24,24\n" * 24)
    return folder


def _start(words: list[str]) -> subprocess.Popen[bytes]:
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, "-m", "entrack", *words], **quiet)  # type: ignore[call-overload]


def _digest(folder: Path, command: Command) -> dict[str, str]:
    """Contents of the results, times left out: they are never the same."""
    files = [p for pattern in command.results for p in folder.glob(pattern)]
    return {
        p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in files
        if not p.name.endswith(".time.txt")
    }


def crash(name: str, kills: int, seed: int = 0) -> tuple[int, int, list[str]]:
    """Kill one command so often; return kills, ends that were compared, and what differed."""
    command, rng = COMMANDS[name], random.Random(f"{name} {seed}")
    broken: list[str] = []
    with tempfile.TemporaryDirectory() as place:
        data = Path(place) / "data"
        data.mkdir()
        _material(data)
        good = Path(place) / "good"
        good.mkdir()
        began = time.monotonic()
        if code := _start(command.words(data, good)).wait():
            return 0, 0, [f"{name} ends with {code} when nobody disturbs it"]
        took, expected = time.monotonic() - began, _digest(good, command)
        killed = ends = 0
        while killed < kills or not ends:
            out = Path(place) / f"out{ends}"
            out.mkdir(exist_ok=True)
            process = _start(command.words(data, out))
            try:
                # In one call of four it may come to its end.
                code = process.wait(rng.uniform(0.1, 1.3) * took if killed < kills else None)
            except subprocess.TimeoutExpired:
                os.kill(process.pid, signal.SIGKILL)
                process.wait()
                killed += 1
                continue
            ends += 1
            found = _digest(out, command)
            if code or found != expected:
                differ = [k for k in expected if found.get(k) != expected[k]]
                broken.append(f"{name}: after {killed} kills code {code}, {differ} differ")
    return killed, ends, broken


def main() -> int:
    """Run from the command line."""
    words = parser(__doc__)
    words.add_argument("--kills", type=int, default=50)
    words.add_argument("--only", nargs="*", choices=list(COMMANDS), default=list(COMMANDS))
    given = words.parse_args()
    figures: dict[str, Any] = {}
    broken: list[str] = []
    for name in given.only:
        killed, ends, wrong = crash(name, given.kills)
        figures[name] = f"{killed} kills {ends} ends"
        broken += wrong
    return tell("crash", figures, broken, given.out)


if __name__ == "__main__":
    sys.exit(main())
