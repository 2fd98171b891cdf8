"""Track one object through a video: python examples/loop.py [VIDEO X,Y,W,H]."""

import sys

import entrack
from entrack.box import parse
from entrack.model import assets

video, box = sys.argv[1:] or (assets() / "demo" / "clip.mp4", "148,153,102,94")

for number, (_image, estimate) in enumerate(entrack.track(video, parse(box))):
    x, y, w, h = estimate.box
    note = "lost" if estimate.lost else f"score {estimate.score:.2f}"
    print(f"{number:4d}  {x:6.1f} {y:6.1f} {w:6.1f} {h:6.1f}  {note}")
