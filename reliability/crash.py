"""Kill commands at random moments: a plain second call has to end as if nothing had happened.

    python -m reliability.crash [--kills 50] [--only evaluate track]

Each command runs once undisturbed. Then it is started and killed with SIGKILL – itself, or it and
its workers at once – again and again in one folder, until a call comes to its end; the folder must
then hold the same results. Then it begins anew in another folder, until it was killed so often.
After each kill every file that has its own name, and not that of an unfinished one, must be whole.
"""

import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

from reliability.commands import COMMANDS, Good, material
from reliability.figures import parser, tell


class Kills(NamedTuple):
    """What came of killing one command."""

    killed: int
    amid: int
    """Kills of a call that had written something and was not done."""
    ends: int
    """Calls that came to their end and were compared."""
    wrong: list[str]


def crash(name: str, good: Good, kills: int, place: Path, seed: int = 0) -> Kills:
    """Kill one command so often, writing below `place`."""
    rng = random.Random(f"{name} {seed}")
    wrong: list[str] = []
    took, killed, amid, ends = good.seconds, 0, 0, 0
    while killed < kills or not ends:
        out = place / f"out{ends}"
        out.mkdir(exist_ok=True)
        began, process = time.monotonic(), good.start(out)
        # In one call of four it may come to its end.
        process.join(rng.uniform(0, 1.3) * took if killed < kills else None)
        if process.exitcode is None:
            (os.kill if rng.random() < 0.5 else os.killpg)(process.pid or 0, signal.SIGKILL)
            process.join()
            killed += 1
            amid += any(out.iterdir())
            wrong += [f"{name}, kill {killed}: {sentence}" for sentence in good.amid(out)]
            continue
        ends += 1
        took += 0.3 * (time.monotonic() - began - took)  # other programs come and go
        if process.exitcode:
            wrong.append(f"{name} after {killed} kills ends with {process.exitcode}: {good.said}")
        wrong += [f"{name} after {killed} kills: {sentence}" for sentence in good.after(out)]
    return Kills(killed, amid, ends, wrong)


def main() -> int:
    words = parser(__doc__)
    words.add_argument("--kills", type=int, default=50)
    words.add_argument("--only", nargs="*", choices=list(COMMANDS), default=list(COMMANDS))
    words.add_argument("--seed", type=int, default=0)
    given = words.parse_args()
    figures: dict[str, Any] = {}
    wrong: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        data = material(Path(folder) / "data")
        for name in given.only:
            place = Path(folder) / name
            good = Good(name, data, place)
            found = crash(name, good, given.kills, place, given.seed)
            figures[name] = (
                f"{found.killed} kills ({found.amid} amid writing), {found.ends} ends, "
                f"{good.seconds:.1f} s a run"
            )
            print(
                f"  {name}: {figures[name]}, {len(found.wrong)} faults", file=sys.stderr, flush=True
            )
            wrong += found.wrong
    return tell("crash", figures, wrong, given.out)


if __name__ == "__main__":
    sys.exit(main())
