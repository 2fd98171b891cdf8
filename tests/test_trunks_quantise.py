"""Int8 trunks: real int8, close to float on every engine and CPU, and refused when not."""
# ruff: noqa: E402

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnxruntime")

from entrack.errors import EntrackError
from entrack.trunk import ENGINES, each, load_trunk
from entrack.trunks.export import export
from entrack.trunks.info import inspect
from entrack.trunks.networks import StudentConfig
from entrack.trunks.quantise import QuantiseConfig, agreement, quantise
from trunk_files import picture, student, write_trunk

QUICK = QuantiseConfig(calibration=8, check=4)


@pytest.fixture(scope="module")
def pictures() -> list[np.ndarray]:
    return [picture(seed) for seed in range(8)]


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_trunk(tmp_path_factory.mktemp("float") / "trunk.onnx")


@pytest.fixture(scope="module")
def int8(exact: Path, pictures: list[np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("int8") / "trunk.onnx"
    quantise(exact, pictures, out, QUICK)
    return out


def test_int8_agrees_with_float_on_both_engines(
    exact: Path, pictures: list[np.ndarray], tmp_path: Path
):
    found = quantise(exact, pictures, tmp_path / "new" / "trunk.onnx", QUICK)
    assert set(found) == {"openvino", "onnxruntime"}
    for a in found.values():
        assert a.cosine > 0.99 and a.response > 0.999 and a.moved < 0.1
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["trunk.onnx"]
    assert (tmp_path / "new" / "trunk.onnx").stat().st_size < 0.5 * exact.stat().st_size


@pytest.mark.parametrize("engine", ENGINES)
def test_the_finer_map_is_there_in_int8_too(exact: Path, int8: Path, engine: str):
    seen = picture(9)[:96, :96][None]
    [float_], [rounded] = (each(load_trunk(path, engine), seen) for path in (exact, int8))
    assert rounded.fine.shape == float_.fine.shape == (24, 12, 12)
    assert np.corrcoef(rounded.fine.ravel(), float_.fine.ravel())[0, 1] > 0.99


def test_convolutions_run_in_int8_the_first_one_too(exact: Path, int8: Path):
    assert load_trunk(int8, "onnxruntime").precision == "int8 and fp32"
    if load_trunk(int8).precision != "int8":
        pytest.skip("this CPU has no int8 kernels in OpenVINO")
    assert list(inspect(int8, size=64).convolutions) == ["int8"]
    assert "int8" not in inspect(exact, size=64).convolutions


def test_same_seed_same_trunk(exact: Path, int8: Path, pictures: list[np.ndarray], tmp_path: Path):
    quantise(exact, pictures, tmp_path / "again.onnx", QUICK)
    assert (tmp_path / "again.onnx").read_bytes() == int8.read_bytes()


def test_agreement_of_a_trunk_with_itself_and_with_noise():
    class Noisy:
        precision = "none"

        def __init__(self, noise: float) -> None:
            self.noise = noise

        def __call__(self, patches):
            rng = np.random.default_rng(0)
            cells = patches.reshape(len(patches), 18, 16, 18, 16, 3).mean((2, 4))
            features = np.tile(cells.transpose(0, 3, 1, 2), (1, 8, 1, 1)) / 255
            added = self.noise * np.random.default_rng(1).normal(size=features.shape)
            return (features * rng.uniform(0.5, 1, features.shape[1:]) + added).astype(np.float32)

    patches = np.stack([picture(seed, 288, 288) for seed in range(4)])
    same = agreement(Noisy(0), Noisy(0), patches, patches)
    assert (same.cosine, same.response, same.moved) == pytest.approx((1, 1, 0), abs=1e-6)
    slight, strong = (agreement(Noisy(0), Noisy(n), patches, patches) for n in (0.01, 0.3))
    assert 1 > slight.cosine > strong.cosine and 1 > slight.response > strong.response


def test_too_strict_a_limit_is_refused_with_its_numbers(
    exact: Path, pictures: list[np.ndarray], tmp_path: Path
):
    strict = QuantiseConfig(calibration=8, check=4, cosine=1.0)
    with pytest.raises(EntrackError, match=r"drifts too far .* cosine of \d\.\d+ \(least 1\.0\)"):
        quantise(exact, pictures, tmp_path / "trunk.onnx", strict)


def test_a_trunk_that_int8_cannot_hold_is_refused_and_nothing_written(
    pictures: list[np.ndarray], tmp_path: Path
):
    """One channel 1 000 times as loud as the others leaves them no steps; float does not care."""
    network = student()
    norm, following = network.body[0][1], network.body[2][0]
    with torch.no_grad():
        norm.weight[0] *= 1000
        norm.bias[0] *= 1000
        following.weight[:, 0] /= 1000
    trunk, out = tmp_path / "loud.onnx", tmp_path / "out" / "trunk.onnx"
    export(network, trunk)
    out.parent.mkdir()
    out.write_bytes(b"what was there")
    with pytest.raises(EntrackError, match="int8 drifts too far from float on openvino"):
        quantise(trunk, pictures, out, QUICK)
    assert [(p.name, p.read_bytes()) for p in out.parent.iterdir()] == [
        ("trunk.onnx", b"what was there")
    ]


def test_wrong_input_is_named(exact: Path, int8: Path, pictures: list[np.ndarray], tmp_path: Path):
    with pytest.raises(EntrackError, match="quantised already"):
        quantise(int8, pictures, tmp_path / "twice.onnx", QUICK)
    with pytest.raises(EntrackError, match="at least two pictures"):
        quantise(exact, pictures[:1], tmp_path / "few.onnx", QUICK)
    with pytest.raises(EntrackError, match="no trunk"):
        quantise(tmp_path / "absent.onnx", pictures, tmp_path / "x.onnx", QUICK)


FEATURES = """
import sys, numpy as np, openvino as ov
network = ov.Core().read_model(sys.argv[1])
run = ov.compile_model(network, "CPU", {"INFERENCE_PRECISION_HINT": "f32"})
np.save(sys.argv[3], run(np.load(sys.argv[2]))[0])
"""


def test_cpus_without_vnni_say_the_same(int8: Path, tmp_path: Path):
    """Without VNNI, int8 products are added in 16 bits, which 8-bit weights would overflow."""
    patches = 255 * np.stack([picture(seed, 96, 96) > 110 for seed in range(4)])
    np.save(tmp_path / "patches.npy", patches.transpose(0, 3, 1, 2).astype(np.float32))
    found = []
    for isa in ("ALL", "AVX2"):
        out = tmp_path / f"{isa}.npy"
        subprocess.run(
            [sys.executable, "-c", FEATURES, int8, tmp_path / "patches.npy", out],
            env=os.environ | {"ONEDNN_MAX_CPU_ISA": isa},
            check=True,
        )
        found.append(np.load(out))
    error = np.square(found[0] - found[1]).mean() / np.square(found[0]).mean()
    assert error < 5e-5


def test_separable_blocks_whose_shortcut_is_used_again_run_on_both_engines(
    pictures: list[np.ndarray], tmp_path: Path
):
    shape = StudentConfig(widths=(16, 16, 16), depths=(1, 2, 2), block="separable")
    exact = write_trunk(tmp_path / "float.onnx", shape)
    lenient = QuantiseConfig(calibration=8, check=4, cosine=0.5, response=0.5)
    assert set(quantise(exact, pictures, tmp_path / "int8.onnx", lenient)) == set(ENGINES)
