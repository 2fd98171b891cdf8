"""`entrack bench`: everything is timed in turn, and every number can be read by a program."""

import json
from pathlib import Path

import numpy as np
import pytest

from entrack import bench
from entrack.cli.app import main
from entrack.model import load_model
from entrack.trunk import load_trunk


@pytest.fixture(scope="module")
def recording() -> bench.Recording:
    return bench.demo(count=6)


class Slow:
    """A tracker that notes what it is shown."""

    def __init__(self, log: list[str], name: str) -> None:
        self.log, self.name = log, name

    def init(self, image, box):
        self.log.append(f"{self.name} init {image.shape} {len(box)}")

    def update(self, image):
        self.log.append(self.name)


def test_calls_take_turns_and_the_first_round_does_not_count():
    order = []
    times = bench.take_turns({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 3)
    assert order == ["a", "b"] * 4
    assert [len(values) for values in times.values()] == [3, 3]


def test_recording_is_the_demo_clip(recording: bench.Recording):
    assert [f.shape for f in recording.frames] == [(360, 640, 3)] * 6
    assert recording.boxes.shape == (6, 4) and len(recording.decode) == 5


def test_trackers_take_turns_through_the_recording(recording: bench.Recording):
    log: list[str] = []
    times = bench.trackers({"a": Slow(log, "a"), "b": Slow(log, "b")}, recording, rounds=2)
    one, other = ([f"{n} init (360, 640, 3) 4", *[n] * 5] for n in "ab")
    assert log == (one + other) * 2
    assert {name: len(values) for name, values in times.items()} == {"a": 6, "b": 6}


def test_every_stage_of_every_frame_is_timed(recording: bench.Recording):
    model = load_model("cf")
    times = bench.stages(model.config, load_trunk(model.trunk, threads=1), recording)
    assert list(times) == ["decode", "window", "trunk", "filter", "frame"]
    assert {len(values) for name, values in times.items() if name != "decode"} == {4}
    medians = {name: np.median(values) for name, values in times.items()}
    assert medians["frame"] > medians["window"] > 0 and medians["filter"] > 0


def test_more_sizes_are_more_work_for_the_trunk(recording: bench.Recording):
    model = load_model("cf")

    class Counting:
        precision = "none"
        seen: list[int] = []  # noqa: RUF012

        def __call__(self, patches):
            self.seen.append(len(patches))
            return np.ones((len(patches), 256, 18, 18), np.float32)

    trunk = Counting()
    bench.stages(bench.with_sizes(model.config, 1), trunk, recording)
    assert set(trunk.seen) == {1, 2}  # the first frame's template, then X' and Z
    trunk.seen.clear()
    bench.stages(bench.with_sizes(model.config, 5), trunk, recording)
    assert max(trunk.seen) == 6


def test_summary_of_known_times():
    found = bench.summary([4.0, 2.0, 6.0])
    assert found == {"ms": 4.0, "ms_p10": 2.4, "ms_p90": 5.6, "fps": 250.0}


def test_command_prints_tables_and_writes_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "bench.json"
    call = ["bench", "--frames", "10", "--threads", "1", "--peers", "--json", str(out)]
    assert main(call) == 0
    shown = capsys.readouterr().out
    found = json.loads(out.read_text())
    assert found["machine"]["threads"] == 1
    assert list(found["stages"]) == ["1", "3"]
    for name in ("cf, one size, openvino", "opencv:csrt"):
        assert found["trackers"][name]["ms"] > 0 and name in shown
    assert found["engines"]["openvino"]["4"]["ms"] > found["engines"]["openvino"]["1"]["ms"]


def test_wrong_calls_say_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["bench", "--model", "nonsense"]) == 2
    assert "no model nonsense" in capsys.readouterr().err
    assert main(["bench", "--nanotrack", str(tmp_path), "--frames", "10"]) == 2
    assert "expected one" in capsys.readouterr().err
