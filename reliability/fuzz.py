"""Feed every reader, the command line and the tracker with what nobody would write on purpose.

    python -m reliability.fuzz [--executions 1000000] [--only TARGET …] [--seed 0]
    python -m reliability.fuzz --guided TARGET     # by coverage, where atheris is installed

Good inputs are mutated: bits, bytes, pieces of one another, numbers at their limits. An execution
fails if it raises anything but `EntrackError`, takes more than 5 s, or more than 1 GB. What failed
is kept in `<out>/fuzz/`; put it into `tests/fuzz/<target>/` with the repair.
"""

import contextlib
import hashlib
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

from entrack import EntrackError
from reliability.figures import parser, tell
from reliability.targets import TARGETS, Target, seeds

SECONDS, MEMORY = 5, 10**9
_TOKENS = [
    *(b"nan", b"inf", b"-1", b"0", b"1e309", b"99999999999999999999", b"\xff\xfe", b"\x00", b"\n"),
    *(
        b",",
        b"\t",
        b'"',
        b"[",
        b"]",
        b"{",
        b"=",
        b"\r",
        b"\x1e",
        b"/../",
        b"\xef\xbb\xbf",
        b"1" * 99,
    ),
    *(
        b"\xd9\xa3",
        b"_",
        b"1_0",
        b"\xe2\x80\xa8",
        b"[" * 3000,
        b"\xff\xff\xff\x7f",
        b"\x80\x00\x00\x00",
    ),
]


class Hang(BaseException):
    """Raised by the alarm; nothing catches it by mistake."""


def mutated(rng: random.Random, corpus: list[bytes]) -> bytes:
    """A good input with one to eight things done to it."""
    data = bytearray(rng.choice(corpus))
    for _ in range(1 << rng.randrange(4)):
        at = rng.randrange(len(data) + 1)
        kind = rng.randrange(8)
        if kind == 0 and data:
            data[at % len(data)] ^= 1 << rng.randrange(8)
        elif kind == 1 and data:
            data[at % len(data)] = rng.randrange(256)
        elif kind == 2:
            data[at:at] = rng.choice(_TOKENS)
        elif kind == 3:
            del data[at : at + rng.randrange(1, 9)]
        elif kind == 4:
            end = at + rng.randrange(1, 9)
            data[at:end] = rng.choice(_TOKENS)
        elif kind == 5:
            other = rng.choice(corpus)
            start = rng.randrange(len(other) + 1)
            data[at:at] = other[start : start + rng.randrange(1, 33)]
        elif kind == 6:
            data[at:at] = data[at : at + rng.randrange(1, 33)]
        else:
            data[at:at] = rng.randbytes(rng.randrange(1, 9))
    return bytes(data[:20_000])


def attempt(target: Target, data: bytes, folder: Path) -> str | None:
    """Run a target once; return what was wrong, or None."""
    signal.alarm(SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            target(data, folder)
    except EntrackError:
        return None
    except Hang:
        return f"took more than {SECONDS} s"
    except Exception:
        return traceback.format_exc(limit=-4)[-2000:]
    finally:
        signal.alarm(0)
    return None


@contextlib.contextmanager
def guarded():
    """Set the alarm's handler, and a limit on memory beyond what is in use."""

    def on_alarm(*_: object) -> None:
        raise Hang

    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    previous = signal.signal(signal.SIGALRM, on_alarm)
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
        signal.signal(signal.SIGALRM, previous)


def _line(wrong: str) -> str:
    """Where a traceback ends: two of the same place are one fault."""
    return ([line for line in wrong.splitlines() if line.startswith("  File ")] or [""])[-1]


def clear(folder: Path) -> None:
    """Empty a folder without making it anew."""
    for path in sorted(folder.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()


def fuzz(
    name: str, executions: int, seed: int, kept: Path, most: int = 20
) -> tuple[int, list[str]]:
    """Run one target so many times; return how often it ran, and the different faults."""
    target, _ = TARGETS[name]
    rng = random.Random(f"{name} {seed}")
    corpus, faults, count = seeds(name), dict[str, str](), 0
    memory = Path("/dev/shm")
    with (
        tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as place,
        guarded(),
    ):
        folder = Path(place)
        for count in range(1, executions + 1):
            data = corpus[count - 1] if count <= len(corpus) else mutated(rng, corpus)
            wrong = attempt(target, data, folder)
            clear(folder)
            if wrong is None:
                continue
            last = wrong.strip().splitlines()[-1][:24]
            place_of = f"{_line(wrong)} {last}"
            if place_of not in faults:
                file = kept / name / hashlib.sha256(data).hexdigest()[:12]
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(data)
                faults[place_of] = f"{file}: {wrong}"
                if len(faults) >= most:
                    break
    return count, list(faults.values())


def guided(name: str, arguments: list[str]) -> None:
    """Hand one target to atheris, which ends the program."""
    import atheris

    target, _ = TARGETS[name]
    folder = Path(tempfile.mkdtemp())

    def once(data: bytes) -> None:
        with contextlib.suppress(EntrackError):
            target(data, folder)
        clear(folder)

    corpus = folder.parent / f"{folder.name}-corpus"
    corpus.mkdir()
    for number, data in enumerate(seeds(name)):
        (corpus / str(number)).write_bytes(data)
    call = [sys.argv[0], "-timeout=5", "-rss_limit_mb=1500", *arguments, str(corpus)]
    _instrument(atheris.instrument_func)
    atheris.Setup(call, once)
    atheris.Fuzz()


def _instrument(one: Callable[[Any], Any]) -> None:
    """Have coverage noted in every function of entrack that is imported by now."""
    for module in [m for name, m in list(sys.modules.items()) if name.startswith("entrack")]:
        for thing in vars(module).values():
            inner = vars(thing).values() if isinstance(thing, type) else [thing]
            for function in inner:
                if isinstance(function, FunctionType) and function.__module__ == module.__name__:
                    one(function)


def main() -> int:
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    words = parser(__doc__)
    words.add_argument("--executions", type=int, default=1_000_000)
    words.add_argument("--only", nargs="*", choices=list(TARGETS), default=list(TARGETS))
    words.add_argument("--seed", type=int, default=0)
    words.add_argument("--guided", choices=list(TARGETS))
    given, rest = words.parse_known_args()
    if given.guided:
        guided(given.guided, rest)
    total = sum(TARGETS[name][1] for name in given.only)
    counts, broken, began = dict[str, int](), list[str](), time.monotonic()
    for name in given.only:
        share = -(-given.executions * TARGETS[name][1] // total)
        started = time.monotonic()
        counts[name], faults = fuzz(name, share, given.seed, given.out / "fuzz")
        broken += [f"{name}: {fault}" for fault in faults]
        took = time.monotonic() - started
        print(f"  {name}: {counts[name]} in {took:.0f} s, {len(faults)} faults", file=sys.stderr)
    figures = {
        "executions": sum(counts.values()),
        "targets": len(counts),
        "faults": len(broken),
        "minutes": round((time.monotonic() - began) / 60, 1),
    }
    return tell("fuzz", figures, broken, given.out)


if __name__ == "__main__":
    sys.exit(main())
