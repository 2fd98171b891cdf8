"""What entrack weighs: import time, help time, memory, size of the base install.

    python benchmarks/footprint.py [--frames 10000] [--install] [--json OUT]

`--install` makes a fresh environment with nothing but the base install (a minute, needs a package
index). Prints each number beside its bar; exit code 1 if one is missed.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from time import perf_counter

ROOT = Path(__file__).resolve().parents[1]
REPEATS = 9
MEMORY = """
import resource, sys
import numpy as np
import entrack
from entrack.bench import demo

def resident():
    for line in open("/proc/self/status"):
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024

recording = demo(90)
tracker = entrack.load("cf", threads=2)
tracker.init(recording.frames[0], recording.boxes[0])
frames = recording.frames + recording.frames[-2:0:-1]  # there and back again
for i in range(1, int(sys.argv[1]) + 1):
    tracker.update(frames[i % len(frames)])
    if i in (100, int(sys.argv[1])):
        print(i, resident())
"""


def seconds(*command: str) -> float:
    """Shortest wall time of a command: the one that nothing else on the machine disturbed."""
    times = []
    for _ in range(REPEATS):
        began = perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        times.append(perf_counter() - began)
    return min(times)


def memory(frames: int) -> dict[int, float]:
    """Resident MB of a process that tracks at 640×360, after 100 frames and after all."""
    call = [sys.executable, "-c", MEMORY, str(frames)]
    done = subprocess.run(call, check=True, capture_output=True, text=True)
    rows = (line.split() for line in done.stdout.splitlines())
    return {int(count): float(size) for count, size in rows}


def install_size() -> float:
    """MB of site-packages after `pip install .`, without what the empty environment has."""
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        packages = next(Path(folder).glob("lib/python*/site-packages"))
        before = occupied(packages)
        subprocess.run([f"{folder}/bin/pip", "install", "-q", str(ROOT)], check=True)
        return occupied(packages) - before


def occupied(folder: Path) -> float:
    return sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) / 1e6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--install", action="store_true")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    python = seconds(sys.executable, "-c", "pass")
    entrack = str(Path(sys.executable).with_name("entrack"))
    rows = [
        ("import entrack, s", seconds(sys.executable, "-c", "import entrack") - python, 0.3),
        ("entrack --help, s", seconds(entrack, "--help"), 0.5),
    ]
    resident = memory(args.frames)
    rows += [(f"resident after {n} frames, MB", size, 500) for n, size in resident.items()]
    rows += [("growth meanwhile, MB", max(resident.values()) - resident[100], 20)]
    if args.install:
        rows += [("base install, MB", install_size(), 730)]
    for what, found, bar in rows:
        print(f"{what:34} {found:9.3f}   at most {bar:g}{'' if found <= bar else '   MISSED'}")
    if args.json:
        args.json.write_text(json.dumps({what: found for what, found, _ in rows}, indent=1))
    return int(any(found > bar for _, found, bar in rows))


if __name__ == "__main__":
    sys.exit(main())
