"""Trunks at run time: both engines, any number of patches, and what is no trunk."""

import warnings
from pathlib import Path
from typing import cast

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("onnxruntime")

from entrack.errors import EntrackError
from entrack.model import load_model
from entrack.trunk import ENGINES, OpenVINOTrunk, each, load_trunk, sha256
from entrack.trunks.dequantise import dequantise
from entrack.trunks.export import export
from entrack.trunks.networks import Student, as_input, fold_all, fold_input
from trunk_files import picture, student, write_trunk


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_trunk(tmp_path_factory.mktemp("trunk") / "trunk.onnx")


@pytest.fixture(scope="module")
def patches() -> np.ndarray:
    return np.stack([picture(seed, 96, 96) for seed in range(5)])


def alike(a: np.ndarray, b: np.ndarray) -> float:
    """Cosine between all features; bf16 on one engine and fp32 on the other are alike to 1e-4."""
    return float((a * b).sum() / np.linalg.norm(a) / np.linalg.norm(b))


@pytest.mark.parametrize("engine", ENGINES)
def test_engines_say_what_the_network_says(engine: str, file: Path, patches: np.ndarray):
    network = fold_input(cast(Student, fold_all(student())))
    expected = [part.detach().numpy() for part in network.maps(as_input(patches))]
    trunk = load_trunk(file, engine, threads=1)
    found = trunk(patches)
    assert found.shape == (5, 256, 6, 6) and found.dtype == np.float32
    assert alike(found, expected[0]) > 0.9999
    fine = np.stack([maps.fine for maps in each(trunk, patches)])
    assert fine.shape == (5, 24, 12, 12) and fine.dtype == np.float32
    assert alike(fine, expected[1]) > 0.9999


def test_z_is_the_finer_map_of_a_trunk_that_tells_no_other(patches: np.ndarray):
    class Plain:
        precision = "none"

        def __call__(self, patches: np.ndarray) -> np.ndarray:
            return patches[:, ::16, ::16].transpose(0, 3, 1, 2).astype(np.float32)

    for maps in each(Plain(), patches):
        assert maps.z.shape == (3, 6, 6) and maps.fine is maps.z


@pytest.mark.parametrize("engine", ENGINES)
def test_a_patch_has_the_same_features_in_any_company(engine: str, file: Path, patches: np.ndarray):
    trunk = load_trunk(file, engine, threads=2)
    together = trunk(patches)
    for count in (1, 2, 4):
        np.testing.assert_allclose(trunk(patches[:count]), together[:count], atol=1e-5)
    np.testing.assert_allclose(trunk(patches[::-1].copy()), together[::-1], atol=1e-5)


@pytest.mark.parametrize("engine", ENGINES)
def test_features_come_in_the_order_of_the_patches(engine: str, file: Path, patches: np.ndarray):
    trunk = load_trunk(file, engine, threads=2)
    together = trunk(patches)
    for found, expected in zip(each(trunk, iter(patches)), together, strict=True):
        np.testing.assert_allclose(found.z, expected, atol=1e-5)
    next(each(trunk, patches))  # and the rest is not asked for
    np.testing.assert_allclose(trunk(patches), together, atol=1e-5)


@pytest.mark.parametrize("engine", ENGINES)
def test_results_are_kept_when_the_trunk_goes_on(engine: str, file: Path, patches: np.ndarray):
    trunk = load_trunk(file, engine, threads=1)
    first = trunk(patches[:1])
    before = first.copy()
    trunk(patches[1:2])
    np.testing.assert_array_equal(first, before)


@pytest.mark.parametrize("engine", ENGINES)
def test_patches_may_change_their_size(engine: str, file: Path):
    trunk = load_trunk(file, engine, threads=1)
    for side in (64, 160, 64):
        assert trunk(np.zeros((2, side, side, 3), np.uint8)).shape == (
            2,
            256,
            side // 16,
            side // 16,
        )


def test_precision_is_what_runs(file: Path):
    import openvino as ov

    fast = "BF16" in ov.Core().get_property("CPU", "OPTIMIZATION_CAPABILITIES")
    assert load_trunk(file).precision == ("bf16" if fast else "fp32")
    assert load_trunk(file, "onnxruntime").precision == "fp32"


def test_engines_round_the_shipped_trunk_alike():
    """In fp32 where it is not int8; rounding before each shortcut, too, would come to .9995."""
    path = load_model("cf").trunk
    seen = np.stack([picture(seed, 288, 288) for seed in range(3)])
    exact = OpenVINOTrunk(path, threads=1)
    exact._options["INFERENCE_PRECISION_HINT"] = "f32"
    assert alike(load_trunk(path, "onnxruntime", threads=1)(seen), exact(seen)) > 0.9996


def test_in_fp32_the_engines_agree_on_the_shipped_trunk_and_stay_near_its_int8():
    path, seen = load_model("cf").trunk, np.stack([picture(seed, 288, 288) for seed in range(2)])
    trunks = [load_trunk(path, engine, 1, precision="fp32") for engine in ENGINES]
    assert [trunk.precision for trunk in trunks] == ["fp32", "fp32"]
    features = [trunk(seen) for trunk in trunks]
    np.testing.assert_allclose(*features, atol=1e-4)
    assert 0.99 < alike(features[0], load_trunk(path, threads=1)(seen)) < 0.9999
    assert features[0].min() == 0


def test_a_float_trunk_is_the_same_in_fp32(file: Path):
    assert dequantise(file) == file.read_bytes()
    assert b"QuantizeLinear" not in dequantise(load_model("cf").trunk)
    with pytest.raises(EntrackError, match="no precision 'fp16': there are model, fp32"):
        load_trunk(file, precision="fp16")


def test_missing_files_and_unknown_engines_are_named(file: Path, tmp_path: Path):
    with pytest.raises(EntrackError, match=r"no trunk .*absent\.onnx"):
        load_trunk(tmp_path / "absent.onnx")
    with pytest.raises(EntrackError, match="no engine 'abacus': there are openvino, onnxruntime"):
        load_trunk(file, "abacus")


def test_a_device_that_does_not_work_is_replaced_by_the_cpu_with_one_warning(
    file: Path, patches: np.ndarray, monkeypatch: pytest.MonkeyPatch
):
    import onnxruntime as ort

    expected = load_trunk(file, "onnxruntime", threads=1)(patches)
    if "CUDAExecutionProvider" in ort.get_available_providers():
        monkeypatch.setattr(ort, "get_available_providers", lambda: ["CPUExecutionProvider"])
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        trunk = load_trunk(file, "onnxruntime", threads=1, device="cuda")
    assert [str(w.message).split(",")[0] for w in heard] == ["ONNX Runtime cannot use cuda here"]
    np.testing.assert_array_equal(trunk(patches), expected)


def test_a_device_that_works_is_used_without_a_warning(file: Path, monkeypatch: pytest.MonkeyPatch):
    import onnxruntime as ort

    both = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    asked = []

    class Session(ort.InferenceSession):
        def __init__(self, path, options, providers):
            asked.append(providers)
            super().__init__(path, options, providers=providers[-1:])

        def get_providers(self):
            return asked[-1]

    monkeypatch.setattr(ort, "get_available_providers", lambda: both)
    monkeypatch.setattr(ort, "InferenceSession", Session)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_trunk(file, "onnxruntime", threads=1, device="cuda")
    assert asked == [both]


@pytest.mark.parametrize(
    ("engine", "device", "why"),
    [
        ("openvino", "cuda", 'openvino runs on the CPU: device "cuda" takes engine="onnxruntime"'),
        ("onnxruntime", "tpu", "no device 'tpu': there are cpu, cuda"),
    ],
)
def test_engines_and_devices_that_do_not_fit_are_refused(
    file: Path, engine: str, device: str, why: str
):
    with pytest.raises(EntrackError, match=why):
        load_trunk(file, engine, device=device)


def test_checksum_sees_one_bit(file: Path, tmp_path: Path):
    copy = tmp_path / "copy.onnx"
    content = bytearray(file.read_bytes())
    copy.write_bytes(content)
    assert sha256(copy) == sha256(file)
    content[-1] ^= 1
    copy.write_bytes(content)
    assert sha256(copy) != sha256(file)


def test_export_replaces_a_trunk_in_one_step(tmp_path: Path):
    path = tmp_path / "trunk.onnx"
    path.write_bytes(b"old")
    export(student(), path)
    assert [p.name for p in tmp_path.iterdir()] == ["trunk.onnx"]
    assert load_trunk(path, threads=1)(np.zeros((1, 32, 32, 3), np.uint8)).shape == (1, 256, 2, 2)
