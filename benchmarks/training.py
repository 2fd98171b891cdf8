"""Environment steps a second of `entrack train`, rollouts and updates together.

python benchmarks/training.py --data folder:CLIPS [--workers 2] [--set KEY=VALUE ...]

The preset `train-default` with next to no warm start, and episodes that are not ended when the
target is lost, so that they are as long as those of a policy that has learned to follow. The first
two rounds are not counted: in them, workers start and open what they need. In the last one the
learner learns alone, which a run of 100 rounds does not notice, but one of 8 did. Processor time,
of all processes together (Linux), says what the machine could do where other programs take turns.
"""

import argparse
import csv
import json
import os
import tempfile
import time
from pathlib import Path

from entrack.learn.grids import changed
from entrack.learn.train import Source, Training, preset
from entrack.model import load_model

SHORT = {
    "bank.looks": 500, "data.made": 2, "warm.steps": 5, "check_every": 1000,
    "episode.patience": 1000,
}  # fmt: skip


def processor_seconds() -> float:
    """Processor time of this process and of all that it started, ended ones included."""
    parents: dict[int, int] = {}
    seconds: dict[int, float] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(") ")[2].split()
        except OSError:
            continue  # it has just ended
        pid = int(path.parent.name)
        parents[pid] = int(fields[1])
        seconds[pid] = sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")

    def ours(pid: int) -> bool:
        return pid == os.getpid() or (pid in parents and ours(parents[pid]))

    return sum(spent for pid, spent in seconds.items() if ours(pid))


def main() -> None:
    """Train, and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", nargs="+", required=True, metavar="FORMAT:DIR")
    parser.add_argument("--config", default="default")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=16)
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE", help="JSON values")
    given = parser.parse_args()
    asked = {k: json.loads(v) for k, v in (word.split("=", 1) for word in given.set)}
    config = changed(preset(given.config), SHORT | {"rounds": given.rounds} | asked)
    ends: list[tuple[float, float]] = []

    def report(stage: str, step: int, steps: int, values: dict[str, float]) -> None:
        if stage == "clips" and step == steps:
            os.sync()  # else they are being written to the disk while the time is taken
        if stage == "policy":
            ends.append((time.perf_counter(), processor_seconds()))

    with tempfile.TemporaryDirectory() as folder:
        source = Source(tuple(given.data))
        run = Path(folder)
        Training(config, load_model("cf"), source, run, given.workers, report=report)()
        rows = list(csv.DictReader((run / "sac.csv").open()))
    steps = [float(row["steps"]) * config.episodes for row in rows]
    seconds, busy = (last - first for last, first in zip(ends[-1], ends[1], strict=True))
    counted = sum(steps[2:])
    updates = f"{config.updates * len(steps[2:])} updates of {config.sac.batch} states"
    print(f"{counted:.0f} steps, {updates} in {seconds:.1f} s: {counted / seconds:.1f} steps/s")
    print(f"processor time {busy:.1f} s: {1000 * busy / counted:.2f} ms a step")
    print(
        f"workers {given.workers}, threads of the learner {config.threads}, load {os.getloadavg()}"
    )


if __name__ == "__main__":
    main()
