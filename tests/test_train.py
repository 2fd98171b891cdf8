"""`entrack train` from clips to a model folder, small enough for a test."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import entrack
from entrack.errors import EntrackError
from entrack.model import load_model
from test_tracker import scene

pytest.importorskip("torch")
pytest.importorskip("gymnasium")

from entrack.cli.app import main
from entrack.config import Config, WindowConfig, parse
from entrack.learn.bank import Chunk
from entrack.learn.bank import Source as Looks
from entrack.learn.config import BankConfig, TrainConfig
from entrack.learn.store import bad_frames, keep, kept
from entrack.learn.train import Source, Training, preset, shortened
from entrack.video import VideoWriter

TINY = """
name = "tiny"
rounds = 2
episodes = 2
updates = 3
capacity = 60
check_every = 1
[data]
validation = ["b"]
[tracker.scale]
steps = 1
[tracker.policy]
f1 = "linear"
reach = 0.05
[episode]
frames = [4, 6]
[sac]
batch = 8
"""


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two annotated videos, and one that never shows its target."""
    folder = tmp_path_factory.mktemp("clips")
    for name, step in ("a", 2.0), ("b", 1.0), ("nothing", 0.0):
        boxes = [[80 + step * k, 80, 40, 40] for k in range(10)]
        with VideoWriter(folder / f"{name}.mp4", 25) as video:
            for k, box in enumerate(boxes):
                video.write(scene((box[0], 80)), k / 25)
        lines = ["nan,nan,nan,nan" if name == "nothing" else ",".join(map(str, b)) for b in boxes]
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


def train(
    config: Path, clips: Path, run: Path, resume: bool = False, report=None, cluster=None
) -> Training:
    settings, base = preset(str(config)), load_model("cf")
    quiet = report or (lambda stage, step, steps, values: None)
    source = Source((f"folder:{clips}",))
    training = Training(settings, base, source, run, 1, resume, quiet, cluster)
    training()
    return training


@pytest.fixture(scope="module")
def trained(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Training]:
    folder = tmp_path_factory.mktemp("train")
    config = folder / "tiny.toml"
    config.write_text(TINY)
    return config, folder / "run", train(config, clips, folder / "run")


def test_a_run_leaves_a_model_that_tracks_and_a_log(trained):
    _, run, training = trained
    tracker = entrack.load(run / "model")
    tracker.init(scene((100, 80)), (100, 80, 40, 40))
    estimate = tracker.update(scene((102, 80)))
    assert np.isfinite(estimate.box).all()
    assert estimate.sigma is not None
    head, *rows = (run / "sac.csv").read_text().splitlines()
    assert len(rows) == 2
    assert all(len(row.split(",")) == len(head.split(",")) for row in rows)
    assert {"return", "iou", "entropy", "loss_q", "iou_validation"} <= set(head.split(","))
    assert "no two frames" in training.failed["nothing"]


def test_the_last_step_fits_the_score_and_switches_the_search_on(
    trained, clips: Path, tmp_path: Path
):
    _, run, _ = trained
    config = tmp_path / "finished.toml"
    config.write_text(
        TINY.replace("rounds = 2", "rounds = 0").replace("reach =", "keep_aspect = true\nreach =")
        + "[finish]\nmade = 1\nframes = 12\n"
    )
    training = train(config, clips, tmp_path / "run")
    before, after = load_model(run / "model").config, load_model(tmp_path / "run" / "model").config
    assert "score" not in training.failed
    assert after.recovery is not None and after.spread is not None and after.update.min_score == 0.3
    assert after.score.bias != before.score.bias
    assert after.policy and after.policy.keep_aspect and after.aspect is not None
    assert before.recovery is None and before.aspect is None


@pytest.mark.xdist_group("ray")
def test_episodes_played_on_ray_make_the_same_policy(trained, clips: Path, tmp_path: Path):
    pytest.importorskip("ray", reason="Ray is not installed: pip install 'entrack[cluster]'")
    config, run, _ = trained
    train(config, clips, tmp_path / "run", cluster="local")
    files = [folder / "model" / "policy.safetensors" for folder in (run, tmp_path / "run")]
    assert files[0].read_bytes() == files[1].read_bytes()


def test_a_stopped_run_resumes_to_the_same_bits(trained, clips: Path, tmp_path: Path):
    config, run, _ = trained
    stopped(config, clips, tmp_path / "run")
    assert not (tmp_path / "run" / "model").exists()
    train(config, clips, tmp_path / "run", resume=True)
    assert bits(tmp_path / "run") == bits(run)


def test_looks_are_through_the_window_that_the_tracker_has(trained):
    _, run, training = trained
    tracker = Config(window=WindowConfig(shape="box", context=4.0, border="mean"))
    chunk = Chunk(
        0, run / "bank", run / "clips", ("a",), (), None, training.base.trunk, tracker,
        BankConfig(), 0,
    )  # fmt: skip
    pair = Looks(chunk).draw(np.random.default_rng(0))
    np.testing.assert_allclose(pair.held[:2], 0.25)
    np.testing.assert_allclose(pair.roi, [0.375, 0.375, 0.25, 0.25])


def test_a_run_with_a_warm_start_resumes_to_the_same_bits(clips: Path, tmp_path: Path):
    config = tmp_path / "warm.toml"
    learned = "[bank]\nlooks = 100\nmade = 0.0\n[warm]\nsteps = 2\nbatch = 8\nwidth = 16\n"
    config.write_text(TINY.replace("linear", "conditioned") + learned)
    train(config, clips, tmp_path / "whole")
    stopped(config, clips, tmp_path / "run")
    train(config, clips, tmp_path / "run", resume=True)
    assert bits(tmp_path / "run") == bits(tmp_path / "whole")


def stopped(config: Path, clips: Path, run: Path) -> None:
    """Train until the first round is over."""

    def stop(stage: str, step: int, steps: int, values: dict[str, float]) -> None:
        if stage == "policy" and step == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(config, clips, run, report=stop)


def bits(run: Path) -> list[bytes]:
    return [(run / name).read_bytes() for name in ("model/policy.safetensors", "sac.csv")]


def test_a_tracker_that_learns_tells_the_box_that_it_works_with() -> None:
    with pytest.raises(EntrackError, match=r"use finish\.aspect"):
        parse(TrainConfig, {"tracker": {"aspect": {}}}, "mine.toml")


def test_a_run_of_another_configuration_is_refused(trained, clips: Path, tmp_path: Path):
    config, run, _ = trained
    other = tmp_path / "other.toml"
    other.write_text(config.read_text().replace("updates = 3", "updates = 4"))
    with pytest.raises(EntrackError, match="updates is 3 there, 4 here"):
        train(other, clips, run, resume=True)
    with pytest.raises(EntrackError, match="add --resume"):
        train(config, clips, run)


def test_data_without_a_usable_clip_is_one_sentence(trained, clips: Path, tmp_path: Path, capsys):
    config, *_ = trained
    folder = tmp_path / "empty"
    folder.mkdir()
    for suffix in ".mp4", ".txt":
        shutil.copy(clips / f"nothing{suffix}", folder)
    words = ["train", "--config", str(config), "--data", f"folder:{folder}", "--out"]
    assert main([*words, str(tmp_path / "run")]) == 1
    said = capsys.readouterr().err
    assert "nothing to learn from" in said and "no two frames" in said
    assert main(["train", "--config", "no.toml", *words[3:], str(tmp_path / "x")]) == 2


def test_frames_that_cannot_be_read_are_left_out_and_counted(tmp_path: Path):
    import cv2

    from entrack.datasets.frames import ImageFiles
    from entrack.datasets.sequence import Sequence

    paths = [tmp_path / f"{k}.png" for k in range(4)]
    for k, path in enumerate(paths):
        cv2.imwrite(str(path), np.full((20, 30, 3), k, np.uint8))
    paths[2].write_bytes(b"no picture")
    boxes = np.arange(16.0).reshape(4, 4)
    assert keep(tmp_path / "store", Sequence("s", ImageFiles(paths), boxes)) == 1
    assert bad_frames(tmp_path / "store", "s") == 1
    assert bad_frames(tmp_path / "store", "another") is None
    [sequence] = kept(tmp_path / "store", ["s"])
    np.testing.assert_array_equal(sequence.boxes, boxes[[0, 1, 3]])
    assert [int(sequence.frames[k][0, 0, 0]) for k in range(3)] == [0, 1, 3]


def test_validation_clips_that_are_not_there_are_told(trained, clips: Path, tmp_path: Path):
    config = tmp_path / "other.toml"
    text = TINY.replace('["b"]', '["b", "0004"]').replace("rounds = 2", "rounds = 0")
    config.write_text(text)
    training = train(config, clips, tmp_path / "run")
    told = "1 of 2 validation clips (not in the data, such as 0004)"
    assert told in shortened(training.failed)
    assert training.checks == ("b",)


@pytest.mark.parametrize("name", ["default", "paper"])
def test_shipped_configurations_are_valid(name: str):
    assert preset(name).name == name
