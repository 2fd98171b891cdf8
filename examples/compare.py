"""Compare two trackers on one video: python examples/compare.py [VIDEO X,Y,W,H A B].

A and B are names as `entrack evaluate --tracker` takes them: default, cf, opencv:csrt, a folder …
"""

import sys

import numpy as np

from entrack.box import iou, parse
from entrack.model import assets
from entrack.peers import parse as contender
from entrack.video import open_source

clip = assets() / "demo" / "clip.mp4"
video, box, *names = sys.argv[1:] or (clip, "148,153,102,94", "default", "opencv:csrt")


def boxes(name: str) -> np.ndarray:
    """Every box of a tracker, (frames, 4)."""
    tracker = contender(name).make()
    found = [parse(box)]
    with open_source(video) as source:
        tracker.init(source.first.image, found[0])
        for frame in source:
            if frame.index > 0:
                answer = tracker.update(frame.image)
                found.append(getattr(answer, "box", answer))
    return np.array(found)


agreement = iou(*map(boxes, names))
apart = np.flatnonzero(agreement < 0.5)
print(f"{names[0]} and {names[1]} agree to a mean IoU of {agreement.mean():.3f}")
print(f"they part in frame {apart[0]}" if len(apart) else "they never part (IoU ≥ 0.5 throughout)")
