"""Frames a second against the number of objects in one video.

    python benchmarks/objects.py [--video FILE] [--objects 1 2 4 8 16 32] [--frames N] [--threads N]
                                 [--cpu]

With --cpu, seconds of the processor are counted instead of the clock's: frames a second of one
core, which hold on a machine that does other things too. Without FILE, a synthetic 1280×720 video
is made. Three ways through it, each with decoding: one tracker with all objects; a tracker for each
object, all through one pass over the video; and a tracker for each object, each with a pass of its
own ("one after the other"). Prints a table; exit code 1 if 8 objects together are not 3 times as
fast as eight trackers one after the other.
"""

import argparse
import sys
import tempfile
import time
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
    parser.add_argument("--model", default="cf")
    parser.add_argument("--cpu", action="store_true")
    args = parser.parse_args()
    clock = time.process_time if args.cpu else time.perf_counter
    most = max(args.objects)
    made = [entrack.load(args.model, threads=args.threads) for _ in range(most)]
    missed = False
    print("objects  together  each a tracker  one after the other  ratio   (frames/s, medians)")
    with tempfile.TemporaryDirectory() as folder:
        video = args.video or Path(folder, "objects.mp4")
        if not args.video:
            write_video(video, most, args.frames)
        for count in args.objects:
            boxes = [place(n, 0) for n in range(count)]

            def one_after_the_other(frames, boxes=boxes):
                for box, tracker in zip(boxes, made, strict=False):
                    pass_over(video, frames, [box], [tracker])

            ways = [
                lambda frames, boxes=boxes: pass_over(video, frames, boxes, made[:1]),
                lambda frames, boxes=boxes: pass_over(video, frames, boxes, made[: len(boxes)]),
                one_after_the_other,
            ]
            for way in ways:  # compiles what it needs
                way(3)
            # They take turns, so that what else the machine does slows all of them.
            rounds = range(args.rounds)
            times = np.median(
                [[seconds(way, args.frames, clock) for way in ways] for _ in rounds], axis=0
            )
            together, each, apart = args.frames / times
            ratio = together / apart
            missed |= count == 8 and ratio < BAR
            print(f"{count:7} {together:9.1f} {each:15.1f} {apart:20.1f} {ratio:6.2f}", flush=True)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
