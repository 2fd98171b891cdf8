"""A tracker of entrack's list as a TraX server, for vot-toolkit; needs the package vot-trax.

python vot_tracker.py opencv:csrt
"""

import sys

import cv2
import numpy as np
import trax

from entrack.datasets.boxes import upright_boxes
from entrack.peers import parse


def main(name):
    tracker = parse(name).make(threads=1)
    with trax.Server(["polygon"], ["path"], ["color"]) as server:
        while True:
            request = server.wait()
            if request.type not in ("initialize", "frame"):
                return
            image = cv2.imread(request.image["color"].path())
            if request.type == "initialize":
                region, _ = request.objects[0]
                box = upright_boxes(np.array([region.get(i) for i in range(4)]).ravel())
                tracker.init(image, box)
            else:
                answer = tracker.update(image)
                box = getattr(answer, "box", answer)
            server.status([(trax.Rectangle.create(*map(float, box)), {})])


main(*sys.argv[1:])
