"""Kill commands at random moments: a plain second call has to end as if nothing had happened.

    python -m reliability.crash [--kills 50] [--only evaluate track] [--add]

Each command runs once undisturbed. Then it is started and killed with SIGKILL – itself, or it and
its workers at once – again and again in one folder, until a call comes to its end; the folder must
then hold the same results. Then it begins anew in another folder, until it was killed so often.
After each kill every file that has its own name, and not that of an unfinished one, must be whole.
Every ten kills are noted in `out/reliability/crash.jsonl`; with --add a call goes on from there.
"""

import json
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

_TURN = 10  # kills of a command before it is another's turn


class Kills(NamedTuple):
    """What came of killing one command."""

    killed: int
    amid: int
    """Kills of a call that had written something and was not done."""
    ends: int
    """Calls that came to their end and were compared."""
    wrong: list[str]


_NONE = Kills(0, 0, 0, [])


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
            begun = any(out.iterdir())
            amid += begun
            took *= 1 if begun else 1.3  # slower than when it ran undisturbed
            wrong += [f"{name}, kill {killed}: {sentence}" for sentence in good.amid(out)]
            continue
        ends += 1
        took += 0.3 * (time.monotonic() - began - took)  # other programs come and go
        if process.exitcode:
            wrong.append(f"{name} after {killed} kills ends with {process.exitcode}: {good.said}")
        wrong += [f"{name} after {killed} kills: {sentence}" for sentence in good.after(out)]
    return Kills(killed, amid, ends, wrong)


def _words(k: Kills) -> str:
    return f"{k.killed} kills ({k.amid} amid writing), {k.ends} ends"


def noted(log: Path) -> dict[str, Kills]:
    """What earlier calls have noted of each command."""
    totals: dict[str, Kills] = {}
    for line in log.read_text().splitlines() if log.exists() else []:
        row = json.loads(line)
        totals[row["name"]] = _sum(totals.get(row["name"], _NONE), Kills(*row["kills"]))
    return totals


def _sum(a: Kills, b: Kills) -> Kills:
    return Kills(*(x + y for x, y in zip(a, b, strict=True)))


def main() -> int:
    words = parser(__doc__)
    words.add_argument("--kills", type=int, default=50)
    words.add_argument("--add", action="store_true", help="to what earlier calls have noted")
    words.add_argument("--only", nargs="*", choices=list(COMMANDS), default=list(COMMANDS))
    words.add_argument("--seed", type=int, default=0)
    given = words.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    log: Path = given.out / "crash.jsonl"
    if not given.add:
        log.unlink(missing_ok=True)
    totals = {name: _NONE for name in given.only} | {
        name: total for name, total in noted(log).items() if name in given.only
    }
    with tempfile.TemporaryDirectory() as folder:
        data = material(Path(folder) / "data")
        goods: dict[str, Good] = {}
        # In turns, so that whoever stops it early has some kills of every command.
        while min(total.killed for total in totals.values()) < given.kills:
            name = min(totals, key=lambda n: totals[n].killed)
            before, place = totals[name], Path(folder) / name / f"after{totals[name].killed}"
            if name not in goods:
                goods[name] = Good(name, data, Path(folder) / name)
            place.mkdir()
            seed = 1000 * given.seed + before.killed
            found = crash(name, goods[name], min(_TURN, given.kills - before.killed), place, seed)
            total = totals[name] = _sum(before, found)
            with log.open("a") as lines:
                lines.write(json.dumps({"name": name, "kills": found}) + "\n")
            print(
                f"  {name}: {_words(total)}, {len(total.wrong)} faults", file=sys.stderr, flush=True
            )
            for sentence in found.wrong:
                print(f"    {sentence}", file=sys.stderr, flush=True)
    figures: dict[str, Any] = {name: _words(total) for name, total in totals.items()}
    wrong = [sentence for total in totals.values() for sentence in total.wrong]
    return tell("crash", figures, wrong, given.out)


if __name__ == "__main__":
    sys.exit(main())
