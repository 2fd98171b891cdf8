"""What tells the one-pass protocols apart, totals, and intervals."""

import numpy as np
import pytest

from entrack.datasets.frames import ImageFiles
from entrack.datasets.sequence import Sequence
from entrack.errors import EntrackError
from entrack.evaluation.protocols import default_protocol, find_protocol


def sequence(boxes, absent=None, name="a"):
    flags = np.zeros(len(boxes), bool) if absent is None else np.array(absent)
    return Sequence(name, ImageFiles([]), np.array(boxes, float), flags, size=(100, 100))


BOX = [10.0, 10, 20, 20]
GONE = [np.nan] * 4


def values(protocol, form, *pairs):
    p = find_protocol(protocol, form)
    return p.values([p.ope(s, [np.array(b, float)]) for s, b in pairs])


def test_frames_without_truth_by_protocol():
    half_gone = (sequence([BOX, BOX, GONE, GONE]), [BOX] * 4)
    assert values("otb", "otb", half_gone)["precision"] == 0.5
    assert values("uav123", "uav123", half_gone)["precision"] == 1
    for protocol in ("otb", "uav123"):
        assert values(protocol, protocol, half_gone)["auc"] == pytest.approx(20 / 21 / 2)


def test_absent_frames_of_lasot_stay_in_the_denominator():
    absent = (sequence([BOX] * 4, [False, False, False, True]), [BOX] * 4)
    assert values("lasot", "lasot", absent)["auc"] == pytest.approx(20 / 21 * 3 / 4)
    assert values("lasot", "lasot", absent)["precision"] == 0.75
    assert values("otb", "lasot", absent)["precision"] == 1


def test_got10k_pools_frames_without_the_first_and_the_absent():
    half = [10.0, 10, 20, 10]
    short = (sequence([BOX] * 2, name="short"), [BOX, half])
    long = (sequence([BOX] * 5, [False] * 4 + [True], name="long"), [half, BOX, BOX, BOX, half])
    assert values("got10k", "got10k", short, long)["ao"] == pytest.approx((0.5 + 3) / 4)
    # the mean of sequences would be (.5 + 1) / 2


def test_the_total_of_otb_is_the_mean_of_sequences():
    good, bad = (sequence([BOX] * 10), [BOX] * 10), (sequence([BOX] * 2), [[80.0, 80, 5, 5]] * 2)
    assert values("otb", "otb", good, bad)["op50"] == 0.5


def test_intervals_hold_the_value_and_shrink_with_more_sequences():
    p = find_protocol("otb", "otb")
    random = np.random.default_rng(0)

    def scores(count):
        steps = np.c_[random.normal(0, 5, (count, 2)), np.zeros((count, 2))]
        return [p.ope(sequence([BOX] * 5), [np.array([BOX] * 5) + step]) for step in steps]

    few, many = scores(10), scores(200)
    widths = []
    for group in (few, many):
        low, high = p.intervals(group)["auc"]
        assert low < p.values(group)["auc"] < high
        widths.append(high - low)
    assert widths[1] < widths[0] / 2
    assert p.intervals(few) == p.intervals(few)


def test_a_protocol_that_does_not_fit_says_which_does():
    with pytest.raises(EntrackError, match="lasot does not fit otb: otb, got10k, longterm do"):
        find_protocol("lasot", "otb")
    with pytest.raises(EntrackError, match="no protocol ope: expected one of otb"):
        find_protocol("ope", "otb")
    assert default_protocol("vot2018") == "vot2018"
    assert default_protocol("folder") == "otb"
