"""Fuzz by coverage: atheris looks for inputs that reach lines of entrack not reached before.

    python -m reliability.guided [--executions 100000] [--only TARGET …]    # pip install atheris

The targets are those of `reliability.fuzz`, each in a process of its own, as a found fault ends it.
"""

import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from reliability.figures import parser, tell
from reliability.targets import TARGETS


def main() -> int:
    words = parser(__doc__)
    words.add_argument("--executions", type=int, default=100_000)
    words.add_argument("--seconds", type=int, default=600, help="of each target, at most")
    words.add_argument("--only", nargs="*", choices=list(TARGETS), default=list(TARGETS))
    given = words.parse_args()
    place: Path = given.out / "guided"
    place.mkdir(parents=True, exist_ok=True)
    figures, wrong, total = dict[str, Any](), list[str](), 0
    began = time.monotonic()
    for name in given.only:
        call = [sys.executable, "-m", "reliability.fuzz", "--guided", name]
        call += [f"-runs={given.executions}", f"-max_total_time={given.seconds}"]
        call.append(f"-artifact_prefix={place}/{name}-")
        done = subprocess.run(call, capture_output=True, text=True, errors="replace")
        runs = re.findall(r"^#(\d+)|Done (\d+) runs", done.stderr, re.MULTILINE)
        count = max((int(number or last) for number, last in runs), default=0)
        total += count
        figures[name] = count
        if done.returncode:
            wrong.append(f"{name}: {done.stderr[-3000:]}")
        print(f"  {name}: {count}, ends with {done.returncode}", file=sys.stderr, flush=True)
    figures = {"executions": total, "minutes": round((time.monotonic() - began) / 60, 1), **figures}
    return tell("guided", figures, wrong, given.out)


if __name__ == "__main__":
    sys.exit(main())
