"""Fitting the score: the regression, what it is fitted to, and the model that comes out."""

from dataclasses import fields, replace

import cv2
import numpy as np
import pytest

import entrack
from entrack import calibrate as cal
from entrack.cli.app import main
from entrack.config import ScoreConfig
from entrack.datasets import Sequence
from entrack.errors import EntrackError
from entrack.model import load_model
from fakes import ball

SIZE = (200, 160)


def test_the_regression_finds_what_made_the_events():
    rng = np.random.default_rng(0)
    x = rng.normal(0, 1, (40_000, 2)) * [0.1, 50] + [3, -200]
    y = rng.random(40_000) < 1 / (1 + np.exp(-(20 * x[:, 0] - 0.04 * x[:, 1] - 68)))
    weights, bias = cal.logistic(x, y)
    assert weights == pytest.approx([20, -0.04], rel=0.1)
    assert bias == pytest.approx(-68, rel=0.1)


def test_the_regression_is_at_the_least_loss():
    rng = np.random.default_rng(1)
    x, y = rng.normal(0, 1, (60, 3)), rng.random(60) < 0.3
    weights, bias = cal.logistic(x, y, ridge=0.0)
    residual = y - 1 / (1 + np.exp(-(x @ weights + bias)))
    assert np.column_stack([x, np.ones(60)]).T @ residual == pytest.approx(np.zeros(4), abs=1e-6)


def test_signals_that_tell_all_or_nothing_keep_weights_finite():
    x = np.column_stack([np.arange(20.0), np.full(20, 7.0), np.full(20, np.nan)])
    weights, bias = cal.logistic(x, np.arange(20) >= 10)
    assert np.isfinite([*weights, bias]).all()
    assert weights[0] > 1 and weights[1:].tolist() == [0, 0]
    p = 1 / (1 + np.exp(-(x[:, 0] * weights[0] + bias)))
    assert p[:9].max() < 0.1 and p[11:].min() > 0.9


def test_a_signal_that_would_count_the_wrong_way_is_left_out():
    rng = np.random.default_rng(2)
    signals = np.zeros((4000, len(cal.SIGNALS)))
    names = [cal.SIGNALS.index(name) for name in ("peak", "first", "rival", "gone")]
    signals[:, names] = rng.normal(0, 1, (4000, 4))
    z = signals[:, names] @ [-1, 2, -1, 1]
    overlaps = (rng.random(4000) < 1 / (1 + np.exp(-z))).astype(float)
    none, one = np.zeros(4000, int), np.zeros((4000, 4))
    weights, _ = cal.fit_score(cal.Sightings(signals, overlaps, overlaps, one, none, none))
    assert weights[names[0]] == 0
    assert weights[names[1:]] == pytest.approx([2, -1, 1], rel=0.3)


def test_the_regression_of_sigma_has_its_share_below_the_line():
    rng = np.random.default_rng(3)
    x = rng.normal(0, 1, (5000, 2))
    y = 1 + x @ [2, 0] + rng.normal(0, 1, 5000) * np.exp(x[:, 1] / 4)
    *weights, bias = cal.quantile(x, y, 0.683)
    assert np.mean(y <= x @ weights + bias) == pytest.approx(0.683, abs=0.01)
    assert weights[0] == pytest.approx(2, abs=0.1)
    assert bias == pytest.approx(1.48, abs=0.1)  # 0.476 standard deviations over the mean


def test_every_weight_of_the_score_has_its_signal():
    settings = {"bias", "lost_below", "found_above"}
    assert {field.name for field in fields(ScoreConfig)} - settings == set(cal.SIGNALS)


def film(gone: range, frames: int = 30, name: str = "film") -> Sequence:
    """The ball; from the first frame of `gone` on, the ground alone."""
    pictures = [ball(t, SIZE)[0] for t in range(frames)]
    boxes = np.array([ball(t, SIZE)[1] for t in range(frames)], float)
    absent = np.isin(np.arange(frames), gone)
    for t in gone:
        x, y, w, h = ball(t, SIZE)[1]
        pictures[t][y : y + h, x : x + w] = (40, 60, 50)
    return Sequence(name, pictures, boxes, absent)


@pytest.fixture(scope="module")
def seen() -> cal.Sightings:
    films = [film(range(12, 30)), film(range(20, 30)), film(range(0))]
    return cal.observe(entrack.load("cf", threads=1), [films])


def test_signals_and_weights_make_the_trackers_own_score(seen):
    score = load_model("cf").config.score
    weights = [getattr(score, name) for name in cal.SIGNALS]
    again = 1 / (1 + np.exp(-(seen.signals @ weights + score.bias)))
    assert again == pytest.approx(seen.scores, abs=1e-6)


def test_an_absent_target_is_no_hit_and_the_start_is_not_seen(seen):
    assert [int((seen.groups == g).sum()) for g in range(3)] == [29, 29, 29]
    assert seen.hits[seen.groups == 2].all()
    assert not seen.hits[seen.groups == 0][11:].any()


def test_a_fit_is_better_than_a_score_that_is_none(seen):
    doubtful = replace(seen, scores=np.full(len(seen.scores), 0.5))
    found = cal.fit(doubtful)
    assert (found.sequences, found.frames) == (3, 87)
    assert found.before.roc_auc == 0.5
    assert found.after is not None and found.after.roc_auc > 0.9
    own = seen.signals @ [found.weights[n] for n in cal.SIGNALS] + found.weights["bias"]
    assert cal.quality(1 / (1 + np.exp(-own)), seen.overlaps).ece < 0.1
    assert cal.fit(seen.of(seen.groups == 0)).after is None


def test_every_dataset_counts_alike():
    rng = np.random.default_rng(4)
    signals = np.zeros((400, len(cal.SIGNALS)))
    signals[:, 0] = rng.normal(0, 1, 400)
    hits = (rng.random(400) < 1 / (1 + np.exp(-2 * signals[:, 0]))).astype(float)
    kinds, errors = np.arange(400) // 300, rng.random((400, 4))
    two = cal.Sightings(signals, hits, hits, errors, kinds, kinds)
    assert two.weights.mean() == pytest.approx(1)
    assert two.weights[:300].sum() == pytest.approx(two.weights[300:].sum())
    often = two.of(np.concatenate([np.arange(300), np.repeat(np.arange(300, 400), 3)]))
    assert cal.fit(often).weights == pytest.approx(cal.fit(two).weights, abs=1e-3)
    assert cal.fit(often).spread == pytest.approx(cal.fit(two).spread, abs=1e-2)


def test_where_every_frame_overlaps_there_is_no_area():
    assert cal.quality([0.9, 0.1], [0.8, 0.3]).roc_auc is None
    assert cal.quality([0.9, 0.1], [0.8, 0.0]).roc_auc == 1


def test_footage_that_teaches_nothing_is_refused(seen):
    for overlap, what in ((0.9, "every frame of 87"), (0.1, "no frame of 87")):
        flat = replace(seen, overlaps=np.full(len(seen.overlaps), overlap))
        with pytest.raises(EntrackError, match=f"{what} has IoU > .5: a score is fitted to"):
            cal.fit(flat)


@pytest.fixture(scope="module")
def footage(tmp_path_factory):
    folder = tmp_path_factory.mktemp("footage")
    for name, gone in (("hidden", range(12, 25)), ("plain", range(0))):
        sequence = film(gone, 25, name)
        (folder / name).mkdir()
        for t, picture in enumerate(sequence.frames):
            cv2.imwrite(str(folder / name / f"{t:04d}.png"), picture)
        boxes = np.where(sequence.absent[:, None], np.nan, sequence.boxes)
        np.savetxt(folder / f"{name}.txt", boxes, delimiter=",")
    return f"folder:{folder}"


def test_the_command_writes_a_model_that_stands_alone(footage, tmp_path, capsys):
    out = tmp_path / "mine"
    words = ["calibrate", "longterm", "--data", footage, "--out", str(out)]
    assert main(words) == 0
    said = capsys.readouterr()
    assert "[config.score]\nbias = " in said.out and "# before: expected" in said.out
    passes = ["1/4 hidden", "2/4 plain", "3/4 hidden", "4/4 plain"]  # it searches, so twice
    assert said.err.splitlines() == passes
    before, after = load_model("longterm"), load_model(out)
    assert after.trunk.parent == out
    assert f"peak = {after.config.score.peak}" in said.out
    assert after.config.spread is not None and f"bias = {after.config.spread.bias}" in said.out
    fitted = {"score": after.config.score, "spread": after.config.spread}
    assert after.config == replace(before.config, **fitted) and after.config != before.config
    assert entrack.load(out, threads=1).config == after.config
    assert main(words) == 2
    assert f"{out} holds a model already" in capsys.readouterr().err


def test_sequences_can_be_chosen(footage, tmp_path, capsys):
    words = ["calibrate", "longterm", "--data", footage, "--out", str(tmp_path / "out")]
    assert main([*words, "--only", "nothing"]) == 2
    assert "no sequence nothing" in capsys.readouterr().err
    assert main([*words, "--only", "plain"]) == 2
    assert "every frame of 24 has IoU > .5" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main([*words, "--only", "hidden", "--frames", "20", "--json"]) == 0
    assert '"frames": 38' in capsys.readouterr().out  # 19, twice
