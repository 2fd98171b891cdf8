"""Track from a camera, frame by frame: python examples/camera.py [CAMERA_OR_VIDEO X,Y,W,H].

Here the loop is yours, as in a robot or a video call: frames come from anywhere, as arrays.
"""

import sys

import cv2

import entrack
from entrack.box import parse
from entrack.model import assets

source, box = sys.argv[1:] or (str(assets() / "demo" / "clip.mp4"), "148,153,102,94")

camera = cv2.VideoCapture(int(source) if source.isdecimal() else source)
there, frame = camera.read()
if not there:
    sys.exit(f"no picture from {source}")

tracker = entrack.load()
tracker.init(frame, parse(box))
was_lost = False
while True:
    there, frame = camera.read()
    if not there:  # the end of a file; a camera goes on until Ctrl-C
        break
    estimate = tracker.update(frame)
    if estimate.lost != was_lost:
        was_lost = estimate.lost
        print("lost: look for the target, and call init again" if was_lost else "found again")
print(f"last seen at {estimate.box.round().astype(int).tolist()}, {estimate.ms:.0f} ms a frame")
