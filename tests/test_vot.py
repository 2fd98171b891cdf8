"""Supervised scores on a video that can be counted by hand."""

import numpy as np
import pytest

from entrack.datasets.frames import ImageFiles
from entrack.datasets.sequence import Sequence
from entrack.evaluation import vot
from entrack.evaluation.protocols import find_protocol
from entrack.evaluation.region import Regions

TRUTH = np.tile([0.0, 0, 9, 9], (30, 1))  # painted to the edge: 10 × 10 pixels
HALF = [0.0, 0, 9, 4]  # 10 × 5 pixels: overlap .5


def run(frames, failures=()):
    """Half of the box in every frame, but for failures, pauses and starts."""
    codes = np.full(frames, vot.REGION)
    codes[0] = vot.START
    for frame in failures:
        codes[frame] = vot.FAILURE
        codes[frame + 1 : frame + vot.SKIP] = vot.UNKNOWN
        if frame + vot.SKIP < frames:
            codes[frame + vot.SKIP] = vot.START
    regions = Regions.of(np.tile(HALF, (frames, 1)))
    regions.corners[codes != vot.REGION] = np.nan
    return vot.Trajectory(codes, regions)


@pytest.fixture
def video():
    return Sequence("bag", ImageFiles([]), TRUTH)


def test_start_and_nine_frames_after_it_do_not_count():
    counted = run(30, [14]).counted()
    assert np.flatnonzero(counted).tolist() == [10, 11, 12, 13, 29]


def test_without_a_failure_everything_is_a_half(video):
    values = find_protocol("vot2016", "vot2016").values([score(video, [run(30)])])
    assert values["accuracy"] == 0.5
    assert values["robustness"] == 0


def score(video, runs, protocol="vot2016"):
    return find_protocol(protocol, "vot2016").supervised(video, runs)


def test_accuracy_and_failures(video):
    values = find_protocol("vot2016", "vot2016").values([score(video, [run(30, [14])])])
    assert values["accuracy"] == 0.5
    assert values["robustness"] == pytest.approx(100 / 30)
    values = find_protocol("vot-toolkit", "vot2016").values(
        [score(video, [run(30, [14])], "vot-toolkit")]
    )
    assert values["robustness"] == 1


def test_fragments_reach_to_the_next_start_or_end_at_the_failure():
    lost = run(30, [14])
    iou = vot.supervised_overlaps(lost, Regions.of(TRUTH), None)
    first, second = vot.fragments(lost, iou)
    assert (len(first[0]), first[1], len(second[0]), second[1]) == (20, True, 11, False)
    assert first[0][1:14] == pytest.approx(0.5)
    assert first[0][14:].tolist() == [0] * 6
    first, second = vot.toolkit_fragments(lost, iou)
    assert (len(first[0]), first[1], len(second[0]), second[1]) == (14, True, 11, False)


def test_a_failure_at_the_end_leaves_no_fragment_behind():
    for failure, frames in ((27, 30), (25, 30)):
        lost = run(frames, [failure])
        iou = vot.supervised_overlaps(lost, Regions.of(TRUTH), None)
        assert len(vot.fragments(lost, iou)) == 1
        assert len(vot.toolkit_fragments(lost, iou)) == 1


def test_expected_overlap_equals_a_slow_loop():
    cut = [
        (np.array([0, 0.5, 0.5, 0, 0]), True, 1.0),
        (np.array([0, 0.8, 0.6]), False, 1.0),
        (np.array([0, 0.2, 0.4, 0.6]), False, 0.5),
    ]
    terms = [vot.expected_overlap_terms([c], 8) for c in cut]
    above, below = sum(t[0] for t in terms), sum(t[1] for t in terms)
    for length in range(1, 8):
        means, weights = [], []
        for values, padded, weight in cut:
            row = list(values) + ([0.0] * (8 - len(values)) if padded else [])
            if length < len(row):
                means.append(sum(row[1 : length + 1]) / length)
                weights.append(weight)
        assert above[length] / below[length] == pytest.approx(np.average(means, weights=weights))


def test_repetitions_are_averaged_frame_by_frame(video):
    whole = run(30)
    whole.regions.corners[1:] = Regions.of(TRUTH[1:]).corners
    values = find_protocol("vot2016", "vot2016").values([score(video, [run(30), whole])])
    assert values["accuracy"] == 0.75


def test_results_of_another_length_are_refused():
    with pytest.raises(ValueError, match="29 frames of results for 30"):
        vot.supervised_overlaps(run(29), Regions.of(TRUTH), None)
