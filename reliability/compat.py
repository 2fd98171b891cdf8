"""Other Pythons, other versions, other machines: the same boxes everywhere.

    python -m reliability.compat [--only 3.12 3.11-lowest places]

For every Python that is found, the newest versions of what the base install needs, and for the
oldest Python the lowest that pyproject.toml allows, are installed into an environment of their own,
and the tests of the base install run there. Then the command is called as it would be on other
machines: see `PLACES`. Needs `uv`.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from entrack.model import assets
from reliability.disk import can_mount, disk
from reliability.figures import parser, tell

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
ENVIRONMENTS = (*PYTHONS, "3.11-lowest")
TESTS = (
    *("box", "boxfiles", "boxes_in_files", "batch", "clip", "cli", "cli_demo", "cli_track"),
    *("cutpaste", "datasets", "demo_clip", "draw", "evaluate", "evaluate_input", "fast", "filter"),
    *("golden", "interop", "longterm", "model", "ope", "peers", "pipeline", "policy", "pool"),
    *("protocols", "raw", "region", "run", "state", "synthetic", "tracker", "trunk"),
    *("uncertainty", "video_sources", "video_writer", "vot", "window"),
)
"""Those that need no extra."""
CLIP = assets() / "demo" / "clip.mp4"
_CALL = ("--box", "148,153,102,94", "--stop", "12", "--boxes")
_AVX2 = {
    "ONEDNN_MAX_CPU_ISA": "AVX2",
    "DNNL_MAX_CPU_ISA": "AVX2",
    "OPENCV_CPU_DISABLE": "AVX512_SKX,AVX512_COMMON,AVX512_CLX,AVX512_CNL,AVX512_ICL",
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL",
}
_POSIX = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
_LATIN = _POSIX | {"LC_ALL": "en_US.ISO-8859-1", "PYTHONIOENCODING": "latin-1"}
PLACES: dict[str, dict[str, str | None]] = {
    "as it is": {},
    "no AVX-512": dict(_AVX2),
    "one thread": {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    "no home": {"HOME": None, "USER": None, "LOGNAME": None, "XDG_CACHE_HOME": None},
    "a home that is not there": {"HOME": "/nonexistent", "XDG_CACHE_HOME": None},
    "POSIX locale": dict(_POSIX),
    "a locale that is not UTF-8": dict(_LATIN),
}
"""What differs in the environment; None: not there."""
ALL_AT_ONCE = _POSIX | PLACES["one thread"] | PLACES["no home"]


def boxes(
    python: Path, folder: Path, change: Mapping[str, str | None] | None = None, *words: str
) -> tuple[np.ndarray, str]:
    """Boxes of the clip as the command writes them to `folder`, or what it said instead."""
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    if os.environ.get("PYTHONPATH") and python == Path(sys.executable):
        env["PYTHONPATH"] = os.environ["PYTHONPATH"]
    for name, value in (change or {}).items():
        env.pop(name, None) if value is None else env.update({name: value})
    table = folder / "boxes é.txt"
    call = [python, "-m", "entrack", "track", str(CLIP), *_CALL, str(table), *words]
    done = subprocess.run(call, env=env, cwd=folder, capture_output=True, timeout=600)
    said = done.stderr.decode(errors="replace")
    if done.returncode or not table.exists():
        return np.empty((0, 4)), f"ends with {done.returncode}: {said[-500:]}"
    return np.loadtxt(table, delimiter=","), said


def same(found: tuple[np.ndarray, str], expected: np.ndarray) -> list[str]:
    """What is wrong with boxes; another machine rounds otherwise, and the last digit is 0.001."""
    rows, said = found
    if rows.shape != expected.shape:
        return [said]
    off = float(np.abs(rows - expected).max())
    return [f"boxes differ by {off:.3f} pixels"] if off > 0.05 else []


def places(python: Path, folder: Path) -> dict[str, list[str]]:
    """Call the command in every place of `PLACES`; what was wrong in each."""
    odd = folder / "with space, é and 漢字"
    odd.mkdir()
    expected, said = boxes(python, folder)
    wrong: dict[str, list[str]] = {"as it is": [] if len(expected) else [said]}
    for name, change in PLACES.items():
        words = ("--threads", "1") if name == "one thread" else ()
        wrong[name] = same(boxes(python, odd, change, *words), expected)
    source = odd / "clip ü.mp4"
    shutil.copyfile(CLIP, source)
    call = [python, "-m", "entrack", "track", source, *_CALL, str(odd / "other ñ.txt")]
    done = subprocess.run(call, cwd=odd, capture_output=True, timeout=600)
    wrong["odd paths"] = [done.stderr.decode(errors="replace")] if done.returncode else []
    return wrong


def uv() -> list[str]:
    """How uv is called."""
    found = shutil.which("uv")
    return [found] if found else [sys.executable, "-m", "uv"]


def _run(call: list[Any], **options: Any) -> tuple[int, str]:
    done = subprocess.run(
        [str(word) for word in call], capture_output=True, text=True, errors="replace", **options
    )
    return done.returncode, done.stdout + done.stderr


def interpreter(version: str) -> str | None:
    """A Python of that version which runs, from PATH or pyenv."""
    there = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python"))
    for path in (shutil.which(f"python{version}"), *map(str, reversed(there))):
        if path and not _run([path, "-c", "pass"])[0]:
            return path
    return None


def environment(name: str, folder: Path) -> tuple[Path, list[str]]:
    """Install the base and what its tests need; return the Python and what was wrong."""
    version, _, lowest = name.partition("-")
    python, found = folder / "bin" / "python", interpreter(version)
    if found is None:
        return python, [f"there is no Python {version} here"]
    code, said = _run([*uv(), "venv", "--quiet", "--python", found, folder])
    if code:
        return python, [said[-500:]]
    call = [*uv(), "pip", "install", "--quiet", "--python", python]
    code, said = _run([*call, *(["--resolution", "lowest-direct"] * bool(lowest)), str(ROOT)])
    if not code:
        code, said = _run([*call, "pytest", "hypothesis", "pytest-xdist"])
    return python, [said[-1500:]] if code else []


def tested(python: Path) -> tuple[str, list[str]]:
    """Run the tests of the base install; return the last line, and what was wrong."""
    files = [str(ROOT / "tests" / f"test_{name}.py") for name in TESTS]
    # With CI hypothesis sets no deadline, which a busy machine would miss.
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"CI": "true"}
    call = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *files]
    code, said = _run(call, cwd=ROOT, env=env)
    lines = said.splitlines()
    failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    return (lines or [""])[-1].strip("= "), failed or ([said[-1500:]] if code else [])


def readonly(source: Path, place: Path) -> list[str]:
    """Run an environment from a disk that cannot be written to, with nowhere to keep anything."""
    with disk(place, "size=2g") as there:
        shutil.copytree(source, there / "env", symlinks=True)
        (there / "work").mkdir()
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        out = place.with_name("written")
        out.mkdir()
        change = {"HOME": str(there / "work")}
        found, expected = (
            boxes(there / "env/bin/python", out, change),
            boxes(source / "bin/python", out),
        )
        return same(found, expected[0])


def main() -> int:
    words = parser(__doc__)
    everything = (*ENVIRONMENTS, "places")
    words.add_argument("--only", nargs="*", choices=everything, default=list(everything))
    given = words.parse_args()
    figures: dict[str, Any] = {}
    wrong: list[str] = []

    def note(name: str, figure: str, faults: list[str]) -> None:
        figures[name] = figure if not faults else "BROKEN"
        print(f"  {name}: {figures[name]}", file=sys.stderr, flush=True)
        wrong.extend(f"{name}: {fault}" for fault in faults)

    with tempfile.TemporaryDirectory() as place:
        for name in given.only:
            folder = Path(place) / name
            if name == "places":
                folder.mkdir()
                for where, faults in places(Path(sys.executable), folder).items():
                    note(where, "same", faults)
                continue
            python, faults = environment(name, folder)
            line = ""
            if not faults:
                line, faults = tested(python)
            note(name, line, faults)
            if name == ENVIRONMENTS[0] and not faults and can_mount():
                note("read-only install", "same", readonly(folder, Path(place) / "readonly"))
    return tell("compat", figures, wrong, given.out)


if __name__ == "__main__":
    sys.exit(main())
