"""`entrack trunk info`: numbers counted by hand."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from entrack.cli.app import main
from entrack.errors import EntrackError
from entrack.model import load_model
from entrack.trunk import sha256
from entrack.trunks.info import inspect


def test_parameters_and_work_of_a_student_counted_by_hand(tmp_path: Path):
    pytest.importorskip("torch")
    from trunk_files import write_trunk

    found = inspect(write_trunk(tmp_path / "trunk.onnx"), threads=1, size=64)
    # (inputs, outputs, kernel, side of the output) of SMALL at 64 pixels
    convolutions = [(3, 8, 3, 32), (8, 16, 3, 16), (16, 16, 3, 16), (16, 16, 3, 16)]
    convolutions += [(16, 24, 3, 8), (24, 24, 3, 8), (16, 24, 1, 8)]
    convolutions += [(24, 32, 3, 4), (32, 32, 3, 4), (24, 32, 1, 4), (32, 256, 1, 4)]
    assert found.parameters == sum(i * o * k * k + o for i, o, k, _ in convolutions)
    assert found.gmac == sum(i * o * k * k * s * s for i, o, k, s in convolutions) / 1e9
    assert sum(found.convolutions.values()) == len(convolutions)


def test_depthwise_convolutions_count_once_a_group(tmp_path: Path):
    pytest.importorskip("torch")
    from entrack.trunks.networks import StudentConfig
    from trunk_files import write_trunk

    config = StudentConfig(stem=(8,) * 4, widths=(8, 8, 8), depths=(1, 0, 0), block="separable")
    found = inspect(write_trunk(tmp_path / "trunk.onnx", config), threads=1, size=64)
    stem = [3 * 8 * 9, 8 * 8 * 9, 8 * 8 * 9, 8 * 8 * 9]
    others = [8 * 16, 16 * 9, 16 * 8, 8 * 256]
    assert found.parameters == sum(stem) + sum(others) + 4 * 8 + 16 + 16 + 8 + 256
    sides = [32, 16, 8, 4, *[4] * 4]
    work = sum(n * side**2 for n, side in zip(stem + others, sides, strict=True))
    assert found.gmac == work / 1e9


def test_model_by_name_has_its_provenance(capsys: pytest.CaptureFixture[str]):
    model = load_model("cf")
    assert main(["trunk", "info", "cf", "--threads", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["sha256"] == sha256(model.trunk) and found["model"] == "cf"
    assert found["provenance"] in (model.folder / "model.toml").read_text()
    assert found["ms"]["openvino"]["alone"] > 0 and found["threads"] == 1
    assert main(["trunk", "info", str(model.trunk), "--threads", "1"]) == 0
    shown = capsys.readouterr().out
    assert f"{found['gmac']:.2f} GMAC" in shown and found["sha256"] in shown
    assert "1 threads" not in shown


def test_what_is_no_trunk_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["trunk", "info", "nonsense"]) == 2
    assert "no model nonsense" in capsys.readouterr().err
    with pytest.raises(EntrackError, match="no model nonsense"):
        inspect("nonsense")
    with pytest.raises(EntrackError, match=r"no trunk .*absent\.onnx"):
        inspect(tmp_path / "absent.onnx")
    (tmp_path / "broken.onnx").write_bytes(b"not a network")
    with pytest.raises(EntrackError, match=r"broken\.onnx is not a trunk that OpenVINO can run"):
        inspect(tmp_path / "broken.onnx")


def test_info_needs_no_extra():
    """Without ONNX Runtime, as in the base install, there is no need of the package onnx either."""
    code = (
        "import sys; sys.modules |= {'torch': None, 'onnx': None, 'onnxruntime': None};"
        "from entrack.cli.app import main; main(['trunk', 'info', '--threads', '1'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "GMAC" in done.stdout
