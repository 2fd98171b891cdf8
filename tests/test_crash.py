"""The short forms of `make crash` and `make disk`: killed twice, out of room once, and shut out."""

import random
from pathlib import Path

import pytest
from reliability.commands import Good, broken, material
from reliability.crash import crash
from reliability.disk import can_mount, fill, forbid, refusal

pytest.importorskip("torch")
pytest.importorskip("gymnasium")
pytest.importorskip("matplotlib")

NAMES = ("track", "evaluate", "train", "trunk")  # the others take longer: `make crash`
MOUNTS = can_mount()


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return material(tmp_path_factory.mktemp("material") / "data")


@pytest.mark.parametrize("name", NAMES)
def test_killed_or_out_of_room_a_second_call_ends_as_if_nothing_had_happened(
    name: str, data: Path, tmp_path: Path
) -> None:
    good = Good(name, data, tmp_path)
    found = crash(name, good, 2, tmp_path)
    assert found.killed == 2 and found.ends and not found.wrong
    if MOUNTS and name == "track":  # the others: `make disk`
        full, wrong = fill(good, random.Random(name).uniform(0.1, 0.7), tmp_path / "disk")
        assert full and not wrong


@pytest.mark.skipif(not MOUNTS, reason="needs the right to mount a disk")
def test_a_read_only_folder_is_one_sentence(data: Path, tmp_path: Path) -> None:
    assert forbid(Good("track", data, tmp_path), tmp_path / "closed") == []


def test_half_a_file_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"a": 1')
    (tmp_path / "b.json").write_text('{"b": 1}')
    (tmp_path / "c.npz").write_bytes(b"PK\x03\x04 and no more")
    assert [line.split(":")[0] for line in broken(tmp_path)] == ["a.json", "c.npz"]


def test_more_than_one_sentence_is_noticed() -> None:
    sentence = "error: cannot write out: No space left on device"
    assert refusal(1, sentence) == []
    for code, said in (0, sentence), (2, sentence), (1, ""), (1, f"Traceback\n{sentence}"):
        assert refusal(code, said)
