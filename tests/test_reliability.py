"""The short forms of `reliability/`: what was found once, a little fuzzing, a few broken videos."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from reliability.compat import ALL_AT_ONCE, PLACES, boxes, same
from reliability.corpus import FAULTS, GOOD, write
from reliability.faults import look
from reliability.fuzz import attempt, fuzz, guarded
from reliability.targets import TARGETS

import entrack
from entrack import EntrackError
from entrack.model import assets, load_model, sha256
from entrack.policy import load_policy
from entrack.video import Clip, open_source

KEPT = sorted((Path(__file__).parent / "fuzz").glob("*/*"))


@pytest.mark.parametrize("path", KEPT, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_inputs_that_once_broke_it_are_answered(path: Path, tmp_path: Path) -> None:
    target, _ = TARGETS[path.parent.name]
    with guarded():
        assert attempt(target, path.read_bytes(), tmp_path) is None


@pytest.mark.parametrize("name", TARGETS)
def test_fuzzing_finds_nothing(name: str, tmp_path: Path) -> None:
    _, share = TARGETS[name]
    count, faults = fuzz(name, 40 * share, 1, tmp_path)
    assert count == 40 * share and not faults


@pytest.mark.parametrize("name", ["mkv-late", "mkv", "grey16", "ten-bit", "tiny", "mov-rotated"])
def test_a_good_video_is_tracked_to_its_end(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(entrack, "load", entrack.load)  # `look` puts a cheap one in its place
    path = tmp_path / f"{name}.{GOOD[name].suffix}"
    write(path, GOOD[name])
    ended, wrong, _ = look(path)
    assert (ended, wrong) == ("whole", [])


@pytest.mark.parametrize("fault", FAULTS)
def test_a_damaged_video_ends_in_a_result_or_one_sentence(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import random

    monkeypatch.setattr(entrack, "load", entrack.load)
    good = tmp_path / "good.mkv"
    write(good, GOOD["mkv"])
    path = tmp_path / f"mkv.{fault}0.mkv"
    for seed in range(3):
        path.write_bytes(FAULTS[fault](good.read_bytes(), random.Random(seed)))
        assert look(path)[1] == []


def test_a_picture_that_claims_a_billion_pixels_is_refused(tmp_path: Path) -> None:
    from entrack.datasets.frames import ImageFiles

    header = b"BM" + bytes(8) + (54).to_bytes(4, "little") + (40).to_bytes(4, "little")
    header += (30_000).to_bytes(4, "little") * 2 + b"\x01\0\x18\0" + bytes(24)
    (tmp_path / "bomb.bmp").write_bytes(header)
    with pytest.raises(EntrackError, match="not a picture"):
        ImageFiles([tmp_path / "bomb.bmp"])[0]


def test_the_main_job_needs_no_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a socket was opened")

    for name in ("connect", "connect_ex", "bind", "sendto"):
        monkeypatch.setattr(socket.socket, name, refuse, raising=False)
    from entrack.cli.app import main

    call = ["track", str(assets() / "demo" / "clip.mp4"), "--box", "148,153,102,94", "--stop", "4"]
    assert main([*call, "--boxes", str(tmp_path / "é ü.csv")]) == 0
    assert (tmp_path / "é ü.csv").read_text().count("\n") == 5


def test_the_main_job_starts_no_process_and_no_connection(tmp_path: Path) -> None:
    """As on a user's machine: what a package does unasked it may leave undone where CI is set."""
    code = """
import sys
def note(event, arguments):
    if event in ("os.fork", "os.posix_spawn", "subprocess.Popen", "socket.connect"):
        print("unasked:", event, flush=True)
sys.addaudithook(note)
from entrack.cli.app import main
assert main(sys.argv[1:]) == 0
import time
time.sleep(0.5)  # what is started in a thread
"""
    call = ["track", str(assets() / "demo" / "clip.mp4"), "--box", "148,153,102,94", "--stop", "3"]
    call += ["--model", "policy", "--boxes", str(tmp_path / "boxes.csv")]
    env = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    env |= {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    said = subprocess.run(
        [sys.executable, "-c", code, *call], env=env, capture_output=True, text=True, timeout=60
    )
    assert (tmp_path / "boxes.csv").exists(), said.stderr
    assert "unasked" not in said.stdout
    assert not (tmp_path / "intel").exists()  # where OpenVINO keeps the number that it reports


def test_the_same_boxes_on_one_thread_without_home_and_locale_in_a_folder_of_any_name(
    tmp_path: Path,
) -> None:
    odd = tmp_path / "with space, é and 漢字"
    odd.mkdir()
    expected, said = boxes(Path(sys.executable), tmp_path)
    assert len(expected) == 12, said
    found = boxes(Path(sys.executable), odd, ALL_AT_ONCE, "--threads", "1")
    assert same(found, expected) == []
    found = boxes(Path(sys.executable), odd, PLACES["a locale that is not UTF-8"])
    assert same(found, expected) == []


@pytest.mark.parametrize("name", ["trunk.xml", "trunk.pkl", "policy.pt"])
def test_a_model_is_numbers_only(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"anything")
    digest = sha256(tmp_path / name)
    text = f'name = "a"\ndescription = ""\n[config]\n[files.trunk]\npath = "{name}"\n'
    (tmp_path / "model.toml").write_text(f'{text}sha256 = "{digest}"\n')
    with pytest.raises(EntrackError, match=r"a model's files are \.onnx and \.safetensors"):
        load_model(tmp_path)


def test_weights_outside_the_checksum_are_refused(tmp_path: Path) -> None:
    from entrack.trunk import load_trunk

    (tmp_path / "trunk.onnx").write_bytes(b"\n\x08location\x12\x07weights")
    with pytest.raises(EntrackError, match="which no checksum covers"):
        load_trunk(tmp_path / "trunk.onnx")


def test_a_policy_of_the_wrong_shape_is_found_when_it_is_read(tmp_path: Path) -> None:
    from safetensors.numpy import load_file, save_file

    model = load_model("policy")
    assert model.policy is not None and model.config.policy is not None
    weights = load_file(model.policy)
    weights["head.weight"] = weights["head.weight"][:, :-1].copy()
    save_file(weights, tmp_path / "policy.safetensors")
    with pytest.raises(EntrackError, match="holds no conditioned policy"):
        load_policy(tmp_path / "policy.safetensors", model.config.policy)


def test_tags_of_a_video_may_be_in_any_alphabet(tmp_path: Path) -> None:
    path = tmp_path / "tagged.mkv"
    write(path, GOOD["mkv"])
    data = path.read_bytes()
    assert b"ENCODER" in data
    path.write_bytes(data.replace(b"ENCODER", b"\xc9NCODER"))  # Latin-1
    with open_source(path) as source, Clip(path) as clip:
        assert len(list(source)) == len(clip) == 24


def test_a_clip_without_a_frame_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "cut.mkv"
    write(path, GOOD["mkv"])
    for size in (300, 500, 700, 900, 1100):
        path.write_bytes(path.read_bytes()[:size])
        with pytest.raises(EntrackError):
            Clip(path)
