"""`entrack trunk train | import | quantise` as a user calls them."""

from pathlib import Path

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnxruntime")

from entrack.cli.app import main  # noqa: E402
from entrack.trunk import load_trunk  # noqa: E402
from entrack.trunks import distil as distillation  # noqa: E402
from entrack.trunks.networks import ResNet18  # noqa: E402
from small_data import make_folder  # noqa: E402
from trunk_files import picture, write_trunk  # noqa: E402

CONFIG = """
threads = 1
[material]
made = 0
every = 2
validation = ["third"]
[student]
stem = [16, 16]
widths = [16, 16, 16]
depths = [1, 1, 1]
[distil]
crops = 80
size = 32
batch = 2
[[finetune]]
pairs = 2
batch = 2
anchor_crops = 2
negatives = 1
stills = 1.0
"""


@pytest.fixture
def call(tmp_path: Path) -> list[str]:
    """`entrack trunk train` on small things."""
    make_folder(tmp_path / "clips")
    (tmp_path / "stills").mkdir()
    for seed in range(4):
        cv2.imwrite(str(tmp_path / "stills" / f"{seed}.jpg"), picture(seed))
    torch.manual_seed(0)
    state = {k: v.numpy() for k, v in ResNet18().state_dict().items()}
    np.savez(tmp_path / "teacher.npz", **state)
    (tmp_path / "small.toml").write_text(CONFIG)
    places = {"--stills": "stills", "--teacher": "teacher.npz", "--out": "run"}
    options = [word for k, v in places.items() for word in (k, str(tmp_path / v))]
    config, data = str(tmp_path / "small.toml"), f"folder:{tmp_path / 'clips'}"
    return ["trunk", "train", config, "--data", data, *options]


def test_train_makes_a_trunk_and_shows_how_it_goes(
    call: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(call) == 0
    shown = capsys.readouterr()
    trunk = tmp_path / "run" / "trunk.onnx"
    assert shown.out.strip() == str(trunk)
    assert load_trunk(trunk)(np.zeros((1, 32, 32, 3), np.uint8)).shape == (1, 256, 2, 2)
    assert "4 stills" in shown.err and "2 clips of folder" in shown.err
    assert "distil" in shown.err and "loss" in shown.err and "finetune 1" in shown.err


def test_quantise_says_how_well_int8_agrees(
    call: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    trunk, out = write_trunk(tmp_path / "trunk.onnx"), tmp_path / "new" / "int8.onnx"
    pictures = str(tmp_path / "stills")
    assert main(["trunk", "quantise", str(trunk), "--pictures", pictures, "--out", str(out)]) == 0
    shown = capsys.readouterr()
    for engine in ("openvino", "onnxruntime"):
        assert f"{engine}: features agree with float to a cosine of " in shown.out
    assert shown.err == "" and "int8" in load_trunk(out, "onnxruntime").precision


def test_ctrl_c_says_how_to_go_on_and_resume_does(
    call: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    calls = []
    honest = distillation.crops.batch

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) == 30:
            raise KeyboardInterrupt
        return honest(*arguments)

    monkeypatch.setattr(distillation.crops, "batch", interrupted)
    assert main(call) == 130
    assert "the same call with --resume goes on" in capsys.readouterr().err
    assert main(call) == 1
    assert "holds a run already: add --resume" in capsys.readouterr().err
    assert main([*call, "--resume"]) == 0
    assert (tmp_path / "run" / "trunk.onnx").is_file()


def test_import_makes_a_model_that_info_knows(
    call: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    teacher, out = str(tmp_path / "teacher.npz"), str(tmp_path / "paper")
    assert main(["trunk", "import", teacher, "--out", out]) == 0
    assert capsys.readouterr().out.strip() == f"{out}/model.toml"
    assert main(["trunk", "info", out, "--threads", "1"]) == 0
    shown = capsys.readouterr().out
    assert "2.78 million parameters" in shown and "imported from teacher.npz" in shown
    assert main(["trunk", "import", teacher, "--out", out]) == 1
    assert "holds a model already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "code", "message"),
    [
        ({"--data": "folder:/nowhere"}, 2, "/nowhere"),
        ({"--data": "clips"}, 2, "a dataset is FORMAT:DIR"),
        ({"--stills": "/nowhere"}, 2, "'/nowhere' does not exist"),
        ({"--teacher": "/nowhere.npz"}, 2, "'/nowhere.npz' does not exist"),
        ({"--out": "/proc/run"}, 1, "cannot write /proc/run"),
    ],
)
def test_wrong_calls_of_train(
    call: list[str],
    change: dict[str, str],
    code: int,
    message: str,
    capsys: pytest.CaptureFixture[str],
):
    for option, value in change.items():
        call[call.index(option) + 1] = value
    assert main(call) == code
    assert message in capsys.readouterr().err.replace("\n", " ")


def test_wrong_keys_of_a_configuration_are_named(
    call: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "small.toml").write_text(CONFIG.replace("crops = 80", "krops = 80"))
    assert main(call) == 2
    assert "distil.krops" in capsys.readouterr().err
    call[2] = str(tmp_path / "absent.toml")
    assert main(call) == 2
    assert "no configuration file" in capsys.readouterr().err


def test_wrong_files_of_quantise_and_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    trunk = write_trunk(tmp_path / "trunk.onnx")
    (tmp_path / "empty").mkdir()
    quantise = ["trunk", "quantise", str(trunk), "--out", str(tmp_path / "out.onnx"), "--pictures"]
    assert main([*quantise, str(tmp_path / "empty")]) == 1
    assert "no .jpg or .png pictures" in capsys.readouterr().err
    assert main([*quantise, str(tmp_path / "nowhere")]) == 2
    assert "does not exist" in capsys.readouterr().err
    assert main(["trunk", "import", str(trunk), "--out", str(tmp_path / "m")]) == 1
    assert "found trunk.onnx" in capsys.readouterr().err
    assert not (tmp_path / "m").exists() and not (tmp_path / "out.onnx").exists()
