"""What goes wrong while a policy is trained, and what is left of the run."""

import multiprocessing
import resource
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from entrack.errors import EntrackError
from test_tracker import scene

pytest.importorskip("torch")
pytest.importorskip("gymnasium")

from entrack.cli.app import main
from entrack.learn import train as training_module
from entrack.trunks import checkpoint
from test_train import TINY, clips, train, trained  # noqa: F401


def same_bits(run: Path, other: Path) -> bool:
    names = "model/policy.safetensors", "sac.csv"
    return all((run / name).read_bytes() == (other / name).read_bytes() for name in names)


def at_first_round(act):
    """A report that calls `act` once, after the first round."""
    return lambda stage, step, steps, values: act() if (stage, step) == ("policy", 1) else None


def test_a_killed_worker_is_replaced_and_changes_nothing(trained, clips, tmp_path):  # noqa: F811
    config, run, _ = trained
    killed: list[int] = []

    def kill() -> None:
        for process in multiprocessing.active_children():
            killed.append(process.pid)
            process.kill()

    training = train(config, clips, tmp_path / "run", report=at_first_round(kill))
    assert killed
    assert set(training.failed) == {"nothing"}  # the clip, and no episode
    assert same_bits(tmp_path / "run", run)


def test_a_full_disk_is_one_sentence_and_the_run_goes_on_from_there(
    trained,  # noqa: F811
    clips: Path,  # noqa: F811
    tmp_path: Path,
):
    config, run, _ = trained
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill() -> None:  # writing beyond fails like a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (5_003, before[1]))

    try:
        with pytest.raises(EntrackError, match=r"cannot write .*run.*File too large"):
            train(config, clips, tmp_path / "run", report=at_first_round(fill))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    train(config, clips, tmp_path / "run", resume=True)
    assert same_bits(tmp_path / "run", run)


def test_damaged_clips_are_learned_from_as_far_as_they_go(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    """A frame that is no picture, boxes that are NaN, a target that is absent for a while."""
    data = tmp_path / "data"
    for name in "a", "b":
        (data / name).mkdir(parents=True)
        for k in range(12):
            cv2.imwrite(str(data / name / f"{k:02d}.png"), scene((80 + 2 * k, 80)))
        boxes = [f"{80 + 2 * k},80,40,40" if k not in (3, 4, 8) else "nan,nan,nan,nan"
                 for k in range(12)]  # fmt: skip
        (data / f"{name}.txt").write_text("\n".join(boxes) + "\n")
    (data / "a" / "05.png").write_bytes(b"no picture")
    config = tmp_path / "tiny.toml"
    config.write_text(
        TINY.replace("[4, 6]", "[10, 10]").replace("[episode]", "[episode]\noracle=1")
    )
    words = ["train", "--config", str(config), "--data", f"folder:{data}", "--workers", "1"]
    assert main([*words, "--out", str(tmp_path / "run")]) == 0
    assert capsys.readouterr().err.count("left out: a (1 of its frames could not be used)") == 1
    head, *rows = (tmp_path / "run" / "sac.csv").read_text().splitlines()
    assert len(rows) == 2
    assert np.isfinite([[float(v) for v in row.split(",")] for row in rows]).all(), head

    def stop(training: training_module.Training) -> Path:
        raise EntrackError("nothing is learned")

    monkeypatch.setattr(training_module.Training, "__call__", stop)
    assert main([*words, "--out", str(tmp_path / "another")]) == 1
    told, _ = capsys.readouterr().err.split("nothing is learned")
    assert "left out: a (1 of its frames could not be used)" in told  # before, not hours later


def test_a_run_in_which_every_episode_fails_stops(
    trained,  # noqa: F811
    clips: Path,  # noqa: F811
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    config, *_ = trained
    monkeypatch.setattr(training_module, "IN_VAIN", 2)
    run = tmp_path / "run"

    def break_clips() -> None:
        for path in (run / "clips").glob("*.npz"):
            path.write_bytes(b"nothing")

    def report(stage: str, step: int, steps: int, values: dict[str, float]) -> None:
        if (stage, step) == ("clips", steps):
            break_clips()

    with pytest.raises(EntrackError, match="2 episodes in a row failed"):
        train(config, clips, run, report=report)
    shutil.rmtree(run / "clips")
    train(config, clips, run, resume=True)
    assert (run / "model" / "model.toml").exists()


def test_every_key_of_another_configuration_is_named_with_both_values(tmp_path: Path):
    checkpoint.claim(tmp_path, {"seed": 0, "sac": {"alpha": 0.2, "hidden": [128]}}, resume=False)
    other = {"seed": 1, "sac": {"alpha": 0.2, "hidden": []}, "warm": {"steps": 9}}
    with pytest.raises(EntrackError) as found:
        checkpoint.claim(tmp_path, other, resume=True)
    assert str(found.value).endswith(
        "another configuration: sac.hidden is [128] there, [] here; seed is 0 there, 1 here; "
        "warm.steps is missing there, 9 here"
    )
