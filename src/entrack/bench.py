"""How fast this machine tracks: where a frame's time goes, and other trackers in the same run.

Stages are timed one by one on recorded inputs, so the tracker itself carries no clocks. Whatever is
compared takes turns, so that a busy machine slows all alike: trust ratios more than milliseconds.
"""

import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from entrack import filter as cf
from entrack import window as windows
from entrack.box import Boxes
from entrack.config import Config
from entrack.datasets.texts import parse_table
from entrack.model import Model, assets
from entrack.peers import Contender, Peer
from entrack.tracker import Tracker
from entrack.trunk import ENGINES, Trunk, load_trunk
from entrack.video import open_source

Times = dict[str, list[float]]
"""Milliseconds of every repetition, by name."""


@dataclass(frozen=True)
class Recording:
    """Frames in memory, and the target's box in each."""

    frames: list[windows.Image]
    boxes: Boxes
    decode: list[float]
    """Milliseconds that each frame took to decode."""


def demo(count: int = 40) -> Recording:
    """Read the first frames of the demo clip, 640×360."""
    clip = assets() / "demo" / "clip.mp4"
    table = clip.with_suffix(".txt")
    boxes = np.array(parse_table(table.read_text(), [4], table.name), np.float64)
    frames: list[windows.Image] = []
    times = [perf_counter()]
    with open_source(clip, stop=count) as source:
        for frame in source:
            frames.append(frame.image)
            times.append(perf_counter())
    # The first frame's time holds the opening of the file.
    decode = [1e3 * (b - a) for a, b in pairwise(times[1:])]
    return Recording(frames, boxes[: len(frames)], decode)


def take_turns(calls: Mapping[str, Callable[[], object]], rounds: int) -> Times:
    """Time each call in every round, after one round that does not count."""
    times: Times = {name: [] for name in calls}
    for turn in range(rounds + 1):
        for name, call in calls.items():
            began = perf_counter()
            call()
            if turn:
                times[name].append(1e3 * (perf_counter() - began))
    return times


def engines(trunk: Path, threads: int, size: int = 288, rounds: int = 40) -> dict[str, Times]:
    """Time one patch, and four at a time, on every engine that is installed."""
    patches = np.random.default_rng(0).integers(0, 255, (4, size, size, 3), dtype=np.uint8)
    calls: dict[str, Callable[[], object]] = {}
    for name, opened in _installed(trunk, threads).items():
        for count in (1, 4):
            calls[f"{name} {count}"] = lambda t=opened, n=count: t(patches[:n])
    times = take_turns(calls, rounds)
    return {e: {n: times[f"{e} {n}"] for n in ("1", "4")} for e in ENGINES if f"{e} 1" in times}


def stages(config: Config, trunk: Trunk, recording: Recording) -> Times:
    """Time what a frame goes through, each stage over all recorded frames."""
    n = config.window.size // 16
    sigma = config.filter.label_sigma * n / config.window.context
    label, taper = cf.spectrum(cf.label(n, sigma)), cf.hann(n)
    zooms = config.scale.factor ** np.arange(
        -(config.scale.steps // 2), config.scale.steps // 2 + 1
    )

    def look(frame: windows.Image, box: NDArray[np.float64]) -> windows.Image:
        """The patches of a frame: each size, and the one that the template learns from."""
        seen = [windows.around(box, config.window, float(zoom)) for zoom in (*zooms, 1.0)]
        return np.stack([windows.crop(frame, w, config.window.border) for w in seen])

    def answer(features: cf.Features) -> cf.Peak:
        """Eqs. 1–3 and 14 on the features of a frame."""
        *candidates, seen = features * taper
        template = cf.spectrum(cf.update(seen, seen, config.update.rate))
        weights = cf.fit(template, label, config.filter.regularisation)
        responses = cf.respond(weights, cf.spectrum(np.stack(candidates)))
        return cf.peak(responses[int(responses.max(axis=(-2, -1)).argmax())])

    tracker = Tracker(config, trunk)
    tracker.init(recording.frames[0], recording.boxes[0])
    times: Times = {
        "decode": recording.decode,
        "window": [],
        "trunk": [],
        "filter": [],
        "frame": [],
    }
    for frame, box in zip(recording.frames, recording.boxes, strict=True):
        patches = _timed(times["window"], look, frame, box)
        features = _timed(times["trunk"], trunk, patches)
        _timed(times["filter"], answer, features)
        _timed(times["frame"], tracker.update, frame)
    return {name: values[2:] for name, values in times.items()}


def trackers(peers: Mapping[str, Peer], recording: Recording, rounds: int = 3) -> Times:
    """Time `update` of each tracker; they take turns at tracking through the recording."""
    times: Times = {name: [] for name in peers}
    for _ in range(rounds):
        for name, peer in peers.items():
            peer.init(recording.frames[0], recording.boxes[0])
            laps: list[float] = []
            for frame in recording.frames[1:]:
                _timed(laps, peer.update, frame)
            times[name] += laps[2:]
    return times


def contenders(model: Model, threads: int, others: Sequence[str] = ()) -> dict[str, Peer]:
    """The model's filter with one and three sizes on each engine, and others by their words."""
    found: dict[str, Peer] = {}
    for engine, trunk in _installed(model.trunk, threads).items():
        for steps, sizes in ((1, "one size"), (3, "three sizes")):
            found[f"{model.name}, {sizes}, {engine}"] = Tracker(
                with_sizes(model.config, steps), trunk
            )
    cv2.setNumThreads(threads)
    for word in others:
        name = ":".join(word.split(":")[:2])  # without the folder of its networks
        found[name] = Contender(name, word).make(threads)
    return found


def with_sizes(config: Config, steps: int) -> Config:
    """The same configuration with another number of sizes."""
    return replace(config, scale=replace(config.scale, steps=steps))


def machine(threads: int) -> dict[str, Any]:
    """What the numbers depend on."""
    import openvino as ov

    packages = ("numpy", "openvino", "opencv-contrib-python-headless", "av")
    return {
        "cpu": ov.Core().get_property("CPU", "FULL_DEVICE_NAME"),
        "cores": os.cpu_count(),
        "threads": threads,
        "system": platform.platform(),
        "python": platform.python_version(),
        "packages": {package: version(package) for package in packages},
    }


def summary(times: Sequence[float]) -> dict[str, float]:
    """Median and spread of some milliseconds, and frames a second."""
    median, tenth, ninetieth = np.percentile(times, [50, 10, 90]).tolist()
    return {"ms": median, "ms_p10": tenth, "ms_p90": ninetieth, "fps": 1e3 / median}


def _installed(trunk: Path, threads: int) -> dict[str, Trunk]:
    names = [name for name in ENGINES if find_spec(name)]
    return {name: load_trunk(trunk, name, threads) for name in names}


def _timed(into: list[float], call: Callable[..., Any], *arguments: Any) -> Any:
    began = perf_counter()
    result = call(*arguments)
    into.append(1e3 * (perf_counter() - began))
    return result
