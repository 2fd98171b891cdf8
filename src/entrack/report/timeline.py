"""One sequence from beginning to end: how well a tracker did, and how sure it was."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from entrack.datasets import Dataset, open_dataset
from entrack.datasets import Sequence as Video
from entrack.errors import EntrackError
from entrack.evaluation import ope
from entrack.evaluation.raw import Results
from entrack.report import plots
from entrack.report.drawing import Drawing, Styles
from entrack.report.plots import Floats
from entrack.report.runs import Section


@dataclass(frozen=True)
class _Told:
    """Overlaps and scores (T,) of one tracker; NaN where it gave no score."""

    tracker: str
    iou: Floats
    score: Floats


def drawings(section: Section, styles: Styles, names: Sequence[str]) -> Iterator[Drawing]:
    """A plot a sequence; none where the dataset is not here any more."""
    for place in dict.fromkeys(result.about["place"] for result in section.results):
        try:
            dataset = open_dataset(f"{section.format}:{place}")
            for name in names:
                video = dataset.read(name)
                told = [*_told(section, dataset, video)]
                heading = f"{name}: overlap and score"
                caption = (
                    "Overlap above, in brackets its mean; score below. Shaded: the target is not "
                    "to be seen."
                )
                make = partial(_figure, video, told, styles, heading)
                yield f"timeline-{name}", heading, caption, make
        except EntrackError:
            continue
        return


def _told(section: Section, dataset: Dataset, video: Video) -> Iterator[_Told]:
    for result in section.results:
        try:
            results = Results(result.raw)
            tables = results.boxes(video, dataset)
            said = results.certainty(video.name, len(video))
        except EntrackError:
            continue
        if tables and len(tables[0]) == len(video):
            iou = ope.overlaps(video.boxes, ope.repair(video.boxes, tables[0]))
            seen = ope.valid(video.boxes) & ~video.absent
            yield _Told(result.tracker, np.where(seen, iou, np.nan), said.score)


def _figure(video: Video, told: Sequence[_Told], styles: Styles, heading: str) -> Figure:
    lines = [
        plots.Curve(t.tracker, styles[t.tracker], t.iou, float(np.nanmean(t.iou))) for t in told
    ]
    below = [plots.Curve(t.tracker, styles[t.tracker], t.score, None) for t in told]
    gone = ~ope.valid(video.boxes) | video.absent
    return plots.stacked((lines, below), gone, heading, ("frame", "IoU", "score"))
