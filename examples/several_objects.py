"""Track several objects at once: python examples/several_objects.py [VIDEO OUT.mp4 X,Y,W,H ...]."""

import sys
from pathlib import Path

import entrack
from entrack.box import parse
from entrack.draw import overlay
from entrack.model import assets
from entrack.video import VideoWriter, open_source

CUPS = ["148,153,102,94", "286,153,102,94", "425,153,102,94"]
video, out, *boxes = sys.argv[1:] or (assets() / "demo" / "clip.mp4", "cups.mp4", *CUPS)

tracker = entrack.load()
with open_source(video) as source, VideoWriter(out, source.fps) as writer:
    for frame in source:
        if frame.index == 0:
            tracker.init_many(frame.image, [parse(box) for box in boxes])
            continue
        estimates = tracker.update_many(frame.image)
        writer.write(overlay(frame.image, estimates, frame.index), frame.time)
scores = ", ".join(f"{estimate.score:.2f}" for estimate in estimates)
print(f"{len(boxes)} objects, scores in the last frame {scores}: see {Path(out)}")
