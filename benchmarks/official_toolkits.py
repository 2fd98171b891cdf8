"""The same raw results, scored by the official toolkits and by entrack.

    python benchmarks/official_toolkits.py --data DATA --work DIR \
        --got10k VENV/bin/python --vot VENV/bin/python [--tracker opencv:mosse]

DATA has `otb/`, `vot/` and `train/`. Each toolkit lives in an environment of its own: `got10k` with
six (which it forgets) and numpy < 2, and `vot-toolkit==0.9.*` with `attributee==0.1.9` and
numpy < 2; this one needs `vot-trax`. Prints a table; exit code 1 if a number differs by more than
1e-4.
"""

import argparse
import json
import subprocess
import sys
from itertools import islice
from pathlib import Path

import numpy as np

from entrack.datasets import open_dataset
from entrack.datasets.synthetic import write
from entrack.evaluation.raw import Results
from entrack.evaluation.run import Evaluation, Options

HERE = Path(__file__).parent / "toolkits"
CLIPS = 6  # of DATA/train, as a small GOT-10k


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--got10k", help="interpreter with the got10k toolkit")
    parser.add_argument("--vot", help="interpreter with vot-toolkit")
    parser.add_argument("--tracker", default="opencv:mosse")
    parser.add_argument("--vot-tracker", default="opencv:csrt")
    args = parser.parse_args()
    rows = []
    if args.got10k:
        rows += compare_otb(args) + compare_got10k(args)
    if args.vot:
        rows += compare_vot(args)
    print(f"{'what':42} {'toolkit':>10} {'entrack':>10} {'difference':>11}")
    for what, theirs, ours in rows:
        print(f"{what:42} {theirs:10.6f} {ours:10.6f} {ours - theirs:+11.1e}")
    return int(any(abs(ours - theirs) > 1e-4 for _, theirs, ours in rows))


def run(data, tracker, out, *protocols):
    """Rows of a run by protocol."""
    rows = Evaluation.prepare([data], [tracker], out, Options(protocols)).run().rows
    return {row["protocol"]: row for row in rows}


def call(*command):
    """Run a script of a toolkit's environment and read the JSON that it prints."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    return json.loads(done.stdout.splitlines()[-1])


def compare_otb(args):
    data, out = f"otb:{args.data}/otb", args.work / "otb"
    row = run(data, args.tracker, out)["otb"]
    folder = out / "otb" / args.tracker.replace(":", "-")
    theirs = call(
        args.got10k, HERE / "got10k_scores.py", "otb", args.data / "otb", folder.parent, folder.name
    )
    return [(f"ExperimentOTB, {args.tracker}, {k}", v, row[k]) for k, v in theirs.items()]


def compare_got10k(args):
    """A few clips in GOT-10k's layout, with a cover label, and the results in its own layout."""
    root, results = args.work / "GOT-10k", args.work / "got10k-results"
    clips = list(islice(open_dataset(f"folder:{args.data}/train"), CLIPS))
    write(clips, root / "val")
    for clip in clips:
        folder = root / "val" / clip.name
        np.savetxt(folder / "cover.label", 8 * ~clip.absent, "%d")
        np.savetxt(folder / "cut_by_image.label", np.zeros(len(clip)), "%d")
        width, height = clip.picture_size()
        (folder / "meta_info.ini").write_text(f"[METAINFO]\nresolution: ({width}, {height})\n")
    row = run(f"got10k:{root}", args.tracker, args.work / "got10k-run", "got10k")["got10k"]
    name = args.tracker.replace(":", "-")
    for clip in clips:
        ours = args.work / "got10k-run" / "got10k" / name / f"{clip.name}.txt"
        theirs = results / "GOT-10k" / name / clip.name / f"{clip.name}_001.txt"
        theirs.parent.mkdir(parents=True, exist_ok=True)
        theirs.write_text(ours.read_text())
        seconds = ours.with_suffix(".time.txt").read_text()
        theirs.with_name(f"{clip.name}_time.txt").write_text(seconds)
    theirs = call(args.got10k, HERE / "got10k_scores.py", "got10k", root, results, name)
    return [(f"ExperimentGOT10k, {args.tracker}, {k}", v, row[k]) for k, v in theirs.items()]


def compare_vot(args):
    """Two supervised runs, the toolkit's and ours, each scored by both."""
    workspace, name = args.work / "vot", args.vot_tracker
    own, label = (
        run(f"vot2016:{args.data}/vot", name, args.work / "vot-run", "vot-toolkit"),
        name.replace(":", "_"),
    )
    workspace.mkdir(parents=True, exist_ok=True)
    if not (workspace / "sequences").exists():
        (workspace / "sequences").symlink_to((args.data / "vot" / "sequences").resolve())
    (workspace / "config.yaml").write_text("registry: [./trackers.ini]\nstack: vot2016/rgb\n")
    (workspace / "trackers.ini").write_text(
        f"[{label}]\nlabel = {name}\nprotocol = traxsingle\n"
        f"command = {sys.executable} {(HERE / 'vot_tracker.py').resolve()} {name}\n"
    )
    vot = [args.vot, HERE / "vot_run.py", "evaluate", "--workspace", workspace]
    words = [*map(str, vot), "--experiments", "baseline", label]
    subprocess.run(words, check=True, stdout=sys.stderr)
    theirs = call(args.vot, HERE / "vot_scores.py", workspace, label)
    results = workspace / "results" / label
    given = run(
        f"vot2016:{args.data}/vot", f"raw:{results}", args.work / "vot-given", "vot-toolkit"
    )
    rows = [
        (f"vot-toolkit's run of {name}, {k}", v, given["vot-toolkit"][k])
        for k, v in theirs["scores"].items()
    ]
    rows += [
        (f"each one's own run of {name}, {k}", v, own["vot-toolkit"][k])
        for k, v in theirs["scores"].items()
    ]
    for sequence, frames in theirs["failures"].items():
        (first, *_) = Results(
            args.work / "vot-run" / "vot2016" / name.replace(":", "-")
        ).trajectories(sequence)
        print(f"{sequence}: vot-toolkit's run fails at {frames}, ours at {first.failures.tolist()}")
    return rows


if __name__ == "__main__":
    sys.exit(main())
