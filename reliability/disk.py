"""Fill the disk under the commands that write, and take it from them: one sentence, nothing lost.

    python -m reliability.disk [--sizes 6] [--only evaluate track]     # as root: it mounts tmpfs

Each command runs once undisturbed. Then it runs on disks that are full after a share of what it
wrote then: it has to end with code 1 and one sentence, every file that has its own name has to be
whole, and on a larger disk a plain second call has to end with the same results. The same with a
disk that is read-only.
"""

import subprocess
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from reliability.commands import COMMANDS, Good, material
from reliability.figures import parser, tell

_PAGE = 4096


def can_mount() -> bool:
    """Whether this process may mount a disk of its own."""
    with tempfile.TemporaryDirectory() as place:
        done = _mount(Path(place), "size=64k")
        if done:
            _unmount(Path(place))
        return done


def _mount(place: Path, options: str) -> bool:
    try:
        call = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)]
        return subprocess.run(call, capture_output=True).returncode == 0
    except OSError:
        return False


def _unmount(place: Path) -> None:
    subprocess.run(["umount", "--lazy", str(place)], check=True)


@contextmanager
def disk(place: Path, options: str) -> Generator[Path, None, None]:
    """A disk of its own at `place`."""
    place.mkdir()
    if not _mount(place, options):
        raise RuntimeError(f"cannot mount {place}")
    try:
        yield place
    finally:
        _unmount(place)


def used(folder: Path) -> int:
    """Bytes that the files of a folder take, in whole pages."""
    return sum(-(-p.stat().st_size // _PAGE) * _PAGE for p in folder.rglob("*") if p.is_file())


def refusal(code: int | None, said: str) -> list[str]:
    """What is wrong with how a command that could not write has ended.

    A list's clips say why, one by one, before the sentence at the end.
    """
    lines = [line for line in said.splitlines() if "error: " in line]
    if code != 1 or len(lines) != 1 or "Traceback" in said or "cannot write" not in said:
        return [f"ends with {code}: {said[-1500:]}"]
    return []


def fill(good: Good, share: float, place: Path) -> tuple[bool, list[str]]:
    """Run on a disk that holds a share of what is written; return if it was full, what is wrong."""
    size = max(_PAGE, int(share * used(good.folder)))
    with disk(place, f"size={size}") as out:
        code = good.call(out)
        full = code != 0
        wrong = refusal(code, good.said) if full else []
        wrong += good.amid(out)
        return full, wrong + _again(good, out)


def forbid(good: Good, place: Path) -> list[str]:
    """Run in a folder in which nothing can be written."""
    with disk(place, "ro") as out:
        return refusal(good.call(out), good.said) + _again(good, out)


def _again(good: Good, out: Path) -> list[str]:
    subprocess.run(["mount", "-o", "remount,rw,size=1g", str(out)], check=True)
    code = good.call(out)
    wrong = [f"the second call ends with {code}: {good.said[-500:]}"] if code else []
    return wrong + good.after(out)


def main() -> int:
    words = parser(__doc__)
    words.add_argument("--sizes", type=int, default=6)
    words.add_argument("--only", nargs="*", choices=list(COMMANDS), default=list(COMMANDS))
    given = words.parse_args()
    if not can_mount():
        print("disk: this needs the right to mount a disk", file=sys.stderr)
        return 1
    figures: dict[str, Any] = {}
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        data = material(Path(folder) / "data")
        for name in given.only:
            place, before = Path(folder) / name, len(wrong)
            good, fulls = Good(name, data, place), 0
            for number in range(given.sizes):
                share = number / given.sizes
                full, faults = fill(good, share, place / f"disk{number}")
                fulls += full
                wrong += [f"{name}, room for {share:.2f}: {fault}" for fault in faults]
            wrong += [f"{name}, read-only: {fault}" for fault in forbid(good, place / "closed")]
            figures[name] = f"{fulls} full disks of {given.sizes}, 1 read-only"
            figures[name] += f", {len(wrong) - before} faults"
            print(f"  {name}: {figures[name]}", file=sys.stderr, flush=True)
    return tell("disk", figures, wrong, given.out)


if __name__ == "__main__":
    sys.exit(main())
