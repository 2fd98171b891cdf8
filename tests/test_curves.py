"""What a training run says of itself, rows and curves; torn by kills and full disks, too."""

import resource
from pathlib import Path

import pytest

from entrack.errors import EntrackError

pytest.importorskip("torch")
pytest.importorskip("tensorboard")

from entrack.trunks.checkpoint import Log
from entrack.trunks.curves import Curves


def shown(folder: Path) -> list[tuple[int, float]]:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder))
    events.Reload()
    return [(event.step, round(event.value, 3)) for event in events.Scalars("loss")]


def test_tensorboard_shows_the_points_and_those_of_a_resumed_run(tmp_path: Path) -> None:
    curves = Curves(tmp_path, 0)
    for step in (1, 2, 3):
        curves.add("loss", 1 / step, step)
    assert shown(tmp_path) == [(1, 1.0), (2, 0.5), (3, 0.333)]
    Curves(tmp_path, 2).add("loss", 0.25, 3)
    assert shown(tmp_path) == [(1, 1.0), (2, 0.5), (3, 0.25)]


@pytest.mark.parametrize("torn", ["", "step,lo", "step,loss\n", "step,loss\n1,0.5\n2,0."])
def test_a_log_that_was_torn_goes_on_after_its_last_whole_row(torn: str, tmp_path: Path) -> None:
    (tmp_path / "sac.csv").write_text(torn)
    Log(tmp_path, "sac", 1).write(2, {"loss": 0.25})
    rows = (tmp_path / "sac.csv").read_text().splitlines()
    assert rows == ["step,loss", *(["1,0.5"] if "1,0.5" in torn else []), "2,0.25"]


def test_a_full_disk_is_an_error_of_ours(tmp_path: Path) -> None:
    log = Log(tmp_path, "sac", 0)
    assert log.curves is not None
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        with pytest.raises(EntrackError, match=r"cannot write .*sac"):
            for step in range(2000):
                log.write(step, {"loss": 0.5})
        with pytest.raises(EntrackError, match=r"cannot write .*tfevents"):
            for step in range(2000):
                log.curves.add("loss", 0.5, step)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
