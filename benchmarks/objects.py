"""Frames a second against the number of objects in one video.

    python benchmarks/objects.py [--video FILE] [--objects 1 2 4 8 16 32] [--frames N] [--threads N]
                                 [--model quick] [--alone cf] [--cpu]

With --cpu, seconds of the processor are counted instead of the clock's: frames a second of one
core, which hold on a machine that does other things too. Without FILE, a synthetic 1280×720 video
is made. Ways through it, each with decoding: one tracker of the model `--model` with all objects;
and a tracker for each object, each with a pass of its own ("one after the other"), once of the same
model and once of `--alone`, what a user has who does not know of the other. They take turns.
Prints a table; exit code 1 if 8 objects together are not 3 times as fast as eight trackers of
`--alone` one after the other.
"""

import argparse
import sys
import tempfile
import time
from functools import partial
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

import entrack
from entrack.pipeline import ahead
from entrack.video import VideoWriter, open_source

BAR = 3
SIZE = (1280, 720)


def place(number: int, t: float) -> tuple[float, float, int, int]:
    """Box of an object at frame `t`: a lane of its own, forwards and back."""
    column, row = number % 8, number // 8
    x = 40 + 155 * column + 30 * np.sin(t / 15 + number)
    y = 30 + 170 * row + 20 * np.cos(t / 20 + number)
    return x, y, 60, 80


def write_video(path: Path, objects: int, frames: int) -> None:
    """Textured objects on a textured ground, as H.264."""
    rng = np.random.default_rng(0)
    ground = rng.integers(60, 130, (45, 80, 3), dtype=np.uint8)
    ground = cv2.resize(ground, SIZE, interpolation=cv2.INTER_CUBIC)
    looks = [
        cv2.resize(rng.integers(0, 255, (8, 6, 3), dtype=np.uint8), (60, 80))
        for _ in range(objects)
    ]
    with VideoWriter(path, 25) as video:
        for t in range(frames):
            image = ground.copy()
            for number, look in enumerate(looks):
                x, y, w, h = map(int, place(number, t))
                image[y : y + h, x : x + w] = look
            video.write(image, t / 25)


def pass_over(video: Path, frames: int, boxes: list, trackers: list) -> None:
    """Track `boxes`, shared out evenly among the trackers, through the video once."""
    share = len(boxes) // len(trackers)
    with open_source(str(video)) as source:
        for t, frame in enumerate(ahead(islice(source, frames))):
            for number, tracker in enumerate(trackers):
                if t:
                    tracker.update_many(frame.image)
                else:
                    own = boxes[number * share : (number + 1) * share]
                    tracker.init_many(frame.image, own)


def seconds(way, frames: int, clock) -> float:
    began = clock()
    way(frames)
    return clock() - began


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--video", type=Path)
    parser.add_argument("--objects", type=int, nargs="+", default=[1, 2, 4, 8, 16, 32])
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--model", default="quick")
    parser.add_argument("--alone", default="cf")
    parser.add_argument("--cpu", action="store_true")
    args = parser.parse_args()
    clock = time.process_time if args.cpu else time.perf_counter
    most, threads = max(args.objects), args.threads
    together = entrack.load(args.model, threads=threads)
    alone = {
        name: [entrack.load(name, threads=threads) for _ in range(most)]
        for name in dict.fromkeys([args.model, args.alone])
    }
    missed = False
    print(f"objects  {args.model}, together" + "".join(f"  {n}, alone  ratio" for n in alone))
    with tempfile.TemporaryDirectory() as folder:
        video = args.video or Path(folder, "objects.mp4")
        if not args.video:
            write_video(video, most, args.frames)
        for count in args.objects:
            boxes = [place(n, 0) for n in range(count)]

            def one_after_the_other(frames, trackers, boxes=boxes):
                for box, tracker in zip(boxes, trackers, strict=False):
                    pass_over(video, frames, [box], [tracker])

            ways = [
                lambda frames, boxes=boxes: pass_over(video, frames, boxes, [together]),
                *(partial(one_after_the_other, trackers=trackers) for trackers in alone.values()),
            ]
            for way in ways:  # compiles what it needs
                way(3)
            times = [[seconds(way, args.frames, clock) for way in ways] for _ in range(args.rounds)]
            first, *others = args.frames / np.median(times, axis=0)
            missed |= count == 8 and first / others[-1] < BAR
            cells = "".join(f"{other:9.1f} {first / other:8.2f}" for other in others)
            print(f"{count:7} {first:9.1f} {cells}", flush=True)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
