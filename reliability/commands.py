"""Small calls of the commands that write for long, and what they have to leave behind.

One run of each takes seconds. A process that has imported everything forks for each call, so that
whoever disturbs them disturbs the work and not the imports.
"""

import hashlib
import json
import multiprocessing
import os
import time
import tomllib
from collections.abc import Callable, Iterator
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import NamedTuple

import numpy as np

from entrack.model import assets

_CLIP = str(assets() / "demo" / "clip.mp4")
_POLICY = """
name = "tiny"
threads = 1
rounds = 2
episodes = 2
updates = 2
capacity = 10
check_every = 1
[data]
validation = ["b"]
[tracker.scale]
steps = 1
[tracker.policy]
f1 = "linear"
[episode]
frames = [4, 4]
[sac]
batch = 4
hidden = [8]
"""
_WARM = """
name = "tiny"
threads = 1
rounds = 2
episodes = 2
updates = 2
capacity = 10
check_every = 1
[data]
validation = ["b"]
[tracker.window]
size = 96
[tracker.scale]
steps = 1
[tracker.policy]
f1 = "conditioned"
[bank]
looks = 100
components = 8
[warm]
steps = 210
batch = 2
width = 8
[episode]
frames = [4, 4]
[sac]
batch = 4
hidden = [8]
"""
_TRUNK = """
threads = 1
[material]
made = 0
[student]
stem = [8, 8]
widths = [8, 8, 8]
depths = [1, 1, 1]
[distil]
crops = 210
size = 32
batch = 1
[[finetune]]
pairs = 20
batch = 2
anchor_crops = 1
negatives = 1
stills = 0.5
[finetune.pair.window]
size = 64
"""


class Command(NamedTuple):
    """A command line that writes to a folder, and which files of that have to be equal."""

    words: Callable[[Path, Path], list[str]]
    """Of the folder with material and the folder to write to."""
    results: tuple[str, ...]
    """Equal whenever they are there."""
    logs: tuple[str, ...] = ()
    """Equal in the end."""
    passing: tuple[str, ...] = ()
    """Equal whenever they are there, but deleted when they are no longer needed."""
    begins: bool = False
    """What was done before a fault is kept under the result's name."""


def _track(data: Path, out: Path) -> list[str]:
    words = ["track", _CLIP, "--model", "cf", "--box", "148,153,102,94", "--stop", "12"]
    return [*words, "--threads", "1", "--boxes", f"{out}/b.txt", "--video", f"{out}/v.mp4"]


def _batch(data: Path, out: Path) -> list[str]:
    words = ["track", "--batch", f"{data}/list.csv", "--workers", "2"]
    return [*words, "--boxes", f"{out}/{{name}}.txt", "--video", f"{out}/{{name}}.mp4"]


def _evaluate(data: Path, out: Path) -> list[str]:
    words = ["evaluate", "--data", f"folder:{data}/clips", "--tracker", "cf", "opencv:kcf"]
    return [*words, "--workers", "1", "--out", str(out)]


def _train(data: Path, out: Path, config: str = "policy") -> list[str]:
    words = ["train", "--config", f"{data}/{config}.toml", "--data", f"folder:{data}/clips"]
    words += ["--stills", f"{data}/stills", "--workers", "1"]
    return [*words, "--out", str(out), "--resume"]


def _warm(data: Path, out: Path) -> list[str]:
    return _train(data, out, "warm")


def _trunk(data: Path, out: Path) -> list[str]:
    words = ["trunk", "train", f"{data}/trunk.toml", "--data", f"folder:{data}/clips"]
    words += ["--stills", f"{data}/stills", "--teacher", f"{data}/teacher.npz"]
    return [*words, "--out", str(out), "--resume"]


def _ablate(data: Path, out: Path) -> list[str]:
    words = ["ablate", "alpha", "--cell", "0", "0.2", "--seeds", "1", "--data"]
    words += [f"folder:{data}/clips", "--config", f"{data}/policy.toml"]
    return [*words, "--workers", "1", "--out", str(out), "--resume"]


COMMANDS: dict[str, Command] = {
    "track": Command(_track, ("b.txt",), begins=True),
    "batch": Command(_batch, ("?.txt",)),
    "evaluate": Command(_evaluate, ("folder/*/?.txt",)),
    "train": Command(
        _train,
        ("model/*", "clips/*"),
        ("sac.csv", "*.safetensors"),
        ("episodes/*", "policies/*"),
    ),
    "warm": Command(  # train, with looks and a warm start
        _warm,
        ("model/*", "clips/*", "bank/*"),
        ("sac.csv", "warm.csv", "*.safetensors"),
        ("episodes/*", "policies/*"),
    ),
    "trunk": Command(_trunk, ("trunk.onnx",), ("*.safetensors",)),
    "ablate": Command(
        _ablate,
        ("cells/*/seed-0/score.json", "cells/*/seed-0/run/model/*"),
        ("ablation.csv", "ablation.md", "ablation.tex", "cells/*/seed-0/run/sac.csv"),
        ("cells/*/seed-0/run/policies/*",),
    ),
}


def material(folder: Path) -> Path:
    """Make what the commands read: clips of a few frames, pictures, a teacher, configurations."""
    import cv2
    import torch

    from entrack.trunks.networks import ResNet18
    from reliability.corpus import GOOD, picture, write

    rows = ["source,x,y,w,h"]
    (folder / "clips").mkdir(parents=True)
    (folder / "stills").mkdir()
    for name in ("a", "b", "c"):
        write(folder / "clips" / f"{name}.mp4", GOOD["mp4"]._replace(frames=8))
        (folder / "clips" / f"{name}.txt").write_text("24,18,24,24\n" * 8)
        rows.append(f"{folder}/clips/{name}.mp4,24,18,24,24")
        still = cv2.resize(picture(ord(name), (96, 72)), (240, 200))
        cv2.imwrite(str(folder / "stills" / f"{name}.jpg"), still)
    (folder / "list.csv").write_text("\n".join(rows) + "\n")
    torch.manual_seed(0)
    weights = {name: tensor.numpy() for name, tensor in ResNet18().state_dict().items()}
    np.savez(folder / "teacher.npz", **weights)  # type: ignore[arg-type]
    for name, text in ("policy", _POLICY), ("warm", _WARM), ("trunk", _TRUNK):
        (folder / f"{name}.toml").write_text(text)
    return folder


_server = multiprocessing.get_context("forkserver")
_OURS = (
    *("cli.app", "cli.track", "cli.evaluate", "learn.ablate", "report.ablation"),
    *("trunks.train", "interop.onnx", "peers.opencv", "cli.batching"),
)
# An optimiser's first use imports torch._dynamo, most of the time of a small training.
_server.set_forkserver_preload(["torch._dynamo", *(f"entrack.{name}" for name in _OURS)])


class Good:
    """What a command leaves behind when nobody disturbs it."""

    def __init__(self, name: str, data: Path, place: Path) -> None:
        self.command, self._data, self._place = COMMANDS[name], data, place
        self.folder = place / "good"
        self.folder.mkdir(parents=True)
        _warm_up()
        code = self.call(self.folder)
        if code:
            raise RuntimeError(f"{name} ends with {code} undisturbed: {self.said}")
        command = self.command
        self._results = digests(self.folder, command.results)
        self._logs = digests(self.folder, command.logs)
        self._passing = digests(self.folder, command.passing)
        assert self._results, f"{name} has no results"

    def start(self, out: Path) -> BaseProcess:
        """Start the command, to write to `out`, in a process and a process group of its own."""
        process = _server.Process(
            target=_run, args=(self.command.words(self._data, out), self._log)
        )
        process.start()
        return process

    def call(self, out: Path) -> int | None:
        """Let it come to its end; return its exit code, and note in `seconds` what it took."""
        began = time.monotonic()
        process = self.start(out)
        process.join()
        self.seconds = time.monotonic() - began
        return process.exitcode

    @property
    def _log(self) -> Path:
        return self._place / "said.txt"

    @property
    def said(self) -> str:
        """What the last call said."""
        return self._log.read_text(errors="replace")

    def amid(self, out: Path) -> list[str]:
        """What is wrong with what a call that did not come to its end has left behind."""
        known = {**self._results, **self._passing}
        patterns = self.command.results + self.command.passing
        wrong = [
            f"{path} is another"
            for path, digest in digests(out, patterns).items()
            if known.get(path, digest) != digest and not self._begins(out, path)
        ]
        return wrong + list(broken(out))

    def _begins(self, out: Path, path: str) -> bool:
        if not self.command.begins:
            return False
        rows = (out / path).read_bytes()
        return rows.endswith(b"\n") and (self.folder / path).read_bytes().startswith(rows)

    def after(self, out: Path) -> list[str]:
        """What is wrong with what a call has left behind that says it is done."""
        ours = {**self._results, **self._logs}
        theirs = digests(out, self.command.results + self.command.logs)
        differ = sorted(k for k in ours.keys() | theirs.keys() if ours.get(k) != theirs.get(k))
        left = [path.name for path in out.rglob("*") if path.suffix in (".part", ".unfinished")]
        return [f"differing {differ}, left behind {left}"] if differ or left else []


def _warm_up() -> None:
    """Have the process that forks import everything now."""
    process = _server.Process(target=os.getpid)
    process.start()
    process.join()


def _run(words: list[str], said: Path) -> None:
    os.setsid()
    target = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(target, 1)
    os.dup2(target, 2)
    from entrack.cli.app import main

    os._exit(main(words))


def digests(folder: Path, patterns: tuple[str, ...]) -> dict[str, str]:
    """Contents of what a command wrote; of archives, what is in them."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(_content(path)).hexdigest()
        for pattern in patterns
        for path in folder.glob(pattern)
        if path.suffix != ".part"
    }


def _content(path: Path) -> bytes:
    if path.suffix != ".npz":  # has the time in it
        return path.read_bytes()
    with np.load(path) as table:
        return b"".join(name.encode() + table[name].tobytes() for name in sorted(table))


def broken(folder: Path) -> Iterator[str]:
    """Files that have their own name and cannot be read to the end."""
    for path in sorted(folder.rglob("*")):
        reader = _READERS.get(path.suffix)
        if reader and path.is_file():
            try:
                reader(path)
            except Exception as error:
                yield f"{path.relative_to(folder)}: {error}"


def _frames(path: Path) -> None:
    from entrack.video import open_source

    with open_source(path) as source:
        assert list(source), "no frame"


def _network(path: Path) -> None:
    import onnx

    onnx.checker.check_model(onnx.load(path))


def _tensors(path: Path) -> None:
    from safetensors.numpy import load_file

    load_file(path)


_READERS: dict[str, Callable[[Path], object]] = {
    ".json": lambda path: json.loads(path.read_bytes()),
    ".toml": lambda path: tomllib.loads(path.read_text()),
    ".npz": _content,
    ".npy": lambda path: np.load(path, mmap_mode="r"),
    ".safetensors": _tensors,
    ".onnx": _network,
    ".mp4": _frames,
}
