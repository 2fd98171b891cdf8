"""What is fuzzed: functions of bytes, any of which may raise `EntrackError` and nothing else.

Each takes bytes, makes of them what a stranger may hand to entrack, and gives it to one reader, to
the command line, or to a tracker. What else they check is said beside each.
"""

import contextlib
import io
import json
import os
import zipfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from entrack import EntrackError
from entrack import box as boxes_
from entrack.batch import read_list
from entrack.config import Config, ScaleConfig, UpdateConfig, WindowConfig, read
from entrack.datasets import open_dataset
from entrack.datasets.frames import ImageFiles
from entrack.datasets.texts import parse_table
from entrack.evaluation import trajectory
from entrack.evaluation.certainty import Certainty
from entrack.evaluation.raw import Results
from entrack.evaluation.region import overlaps
from entrack.model import load_model
from entrack.policy import load_policy
from entrack.tracker import Tracker
from entrack.video import open_source

Target = Callable[[bytes, Path], None]


class Means:
    """A trunk that costs nothing: the mean colour of each 16 × 16 cell."""

    precision = "fp32"

    def __call__(self, patches: np.ndarray) -> np.ndarray:
        n, size, cells = len(patches), patches.shape[1], patches.shape[1] // 16
        cut = patches.reshape(n, cells, size // cells, cells, size // cells, 3)
        means = cut[:, :, ::5, :, ::5].mean(axis=(2, 4), dtype=np.float32)
        return np.ascontiguousarray(means.transpose(0, 3, 1, 2)) / 255 - 0.5


def _text(data: bytes) -> str:
    return data.decode("utf-8", "replace")


def box_string(data: bytes, folder: Path) -> None:
    """`--box`: what is accepted is finite and has a size."""
    box = boxes_.parse(_text(data))
    assert np.isfinite(box).all() and (box[2:] > 0).all()


def table(data: bytes, folder: Path) -> None:
    """OTB, LaSOT, GOT-10k and VOT ground truth: as many columns as asked for."""
    columns = ([4], [4, 8], [1])[data[0] % 3] if data else [4]
    rows = parse_table(_text(data[1:]), columns, "truth.txt")
    assert rows.ndim == 2 and rows.shape[1] in columns


def vot_text(data: bytes, folder: Path) -> None:
    """VOT's trajectories as text: what was read can be written, read again and scored."""
    run = trajectory.read_text(_text(data), "bag_001.txt")
    again = trajectory.read_text(trajectory.write_text(run), "bag_001.txt")
    assert (again.codes == run.codes).all()
    overlaps(run.regions, again.regions, (640, 480))


def vot_binary(data: bytes, folder: Path) -> None:
    """VOT's binary trajectories: as `vot_text`."""
    run = trajectory.read_binary(data, "bag_001.bin")
    again = trajectory.read_binary(trajectory.write_binary(run), "bag_001.bin")
    assert (again.codes == run.codes).all()
    overlaps(run.regions, again.regions, (640, 480), toolkit=True)


def scores(data: bytes, folder: Path) -> None:
    """What a tracker said of itself, CSV."""
    Certainty.read(_text(data), "a.score.csv").write()


def clip_list(data: bytes, folder: Path) -> None:
    """`track --batch`: names stay below the folder of the results."""
    (folder / "list.csv").write_bytes(data)
    for clip in read_list(folder / "list.csv", folder / "out" / "{name}.csv", None):
        assert clip.table is not None
        assert (folder / "out").resolve() in clip.table.resolve().parents


def configuration(data: bytes, folder: Path) -> None:
    """A tracker's TOML."""
    (folder / "config.toml").write_bytes(data)
    Tracker(read(Config, folder / "config.toml"), Means())


def annotations(data: bytes, folder: Path) -> None:
    """Ground truth as JSON."""
    (folder / "truth.json").write_bytes(data)
    _read_all(f"{_pick(data, ('otb', 'vot2018', 'lasot', 'got10k'))}:{folder}/truth.json")


def _pick(data: bytes, choices: Sequence[str]) -> str:
    return choices[(data[-1] if data else 0) % len(choices)]


def _read_all(spec: str) -> None:
    dataset = open_dataset(spec)
    for name in dataset.names:
        sequence = dataset.read(name)
        assert sequence.boxes.shape == (len(sequence), 4)
        with contextlib.suppress(IndexError):
            sequence.picture_size()


_PLACES = {
    "otb": ("Basketball/groundtruth_rect.txt", "Basketball/img/0001.jpg"),
    "uav123": ("anno/UAV123/bike1.txt", "data_seq/UAV123/bike1/000001.jpg"),
    "lasot": (
        "airplane/airplane-1/groundtruth.txt",
        "airplane/airplane-1/full_occlusion.txt",
        "airplane/airplane-1/out_of_view.txt",
    ),
    "got10k": ("a/groundtruth.txt", "a/cover.label", "a/meta_info.ini", "list.txt"),
    "vot2018": ("bag/groundtruth.txt", "bag/sequence", "bag/color/00000001.jpg", "list.txt"),
    "folder": ("a.txt", "a/0.jpg", "a.mp4"),
}


def dataset(data: bytes, folder: Path) -> None:
    """A dataset's folder: every file of it is bytes, split at 0x1e; a missing one is not there."""
    form = _pick(data, tuple(_PLACES))
    root = folder / form
    for place, content in zip(_PLACES[form], data[:-1].split(b"\x1e"), strict=False):
        path = root / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    _read_all(f"{form}:{root}")


def results(data: bytes, folder: Path) -> None:
    """Somebody's results: a folder or a zip file of them."""
    if data[:1] == b"Z":
        (folder / "r.zip").write_bytes(data[1:])
        found = Results(folder / "r.zip")
        for name in ("bag", "Basketball"):
            found.trajectories(name)
            found.times(name)
        return
    texts = data.split(b"\x1e")
    names = ("bag_001.txt", "bag_001_time.value", "bag.score.csv", "bag_001_confidence.value")
    root = folder / "r" / "baseline" / "bag"
    root.mkdir(parents=True, exist_ok=True)
    for name, content in zip(names, texts, strict=False):
        (root / name).write_bytes(content)
    found = Results(folder / "r")
    runs, times = found.trajectories("bag"), found.times("bag")
    assert np.isfinite(times).all()
    for run in runs:
        found.certainty("bag", len(run))


def picture(data: bytes, folder: Path) -> None:
    """A picture file of a sequence: as `cv2` reads it, or one sentence."""
    (folder / "0001.png").write_bytes(data)
    image = ImageFiles([folder / "0001.png"])[0]
    assert image.dtype == np.uint8 and image.ndim == 3


def model_folder(data: bytes, folder: Path) -> None:
    """`model.toml`; a file of it is taken only with its checksum."""
    (folder / "trunk.onnx").write_bytes(b"trunk")
    (folder / "policy.safetensors").write_bytes(b"policy")
    (folder / "model.toml").write_bytes(data)
    load_model(folder)


def policy(data: bytes, folder: Path) -> None:
    """A policy's weights: what is accepted can act."""
    (folder / "policy.safetensors").write_bytes(data)
    config = load_model("policy").config.policy
    assert config is not None
    load_policy(folder / "policy.safetensors", config)


_WORDS = (
    *("track", "evaluate", "report", "data", "check", "list", "synth", "trunk", "info", "vot"),
    *("calibrate", "explain", "train", "--box", "1,2,3,4", "1,2", "nan,1,1,1", "--model", "cf"),
    *("--out", "o", "--boxes", "o.csv", "--video", "o.mp4", "--start", "--stop", "-1", "0", "1e9"),
    *("a.txt", "none", "--data", "otb:.", "folder:.", "xyz", "--tracker", "raw:.", "--protocol"),
    *("otb", "--threads", "99999999999999999999", "--help", "--json", "--debug", "", "\x00", "é"),
    *("--batch", "--workers", "2", "--seed", "opencv:kcf", "os:path", "\udcff", "*", "//x", "a://"),
)


def command_line(data: bytes, folder: Path) -> None:
    """Words after `entrack`: the code is 0, 1 or 2, and an error is one line without traceback."""
    from entrack.cli.app import main

    words = [_WORDS[b % len(_WORDS)] if b < 240 else chr(b) * 3 for b in data[:8]]
    if words and {words[0], *words[1:2]} & {"explain", "train", "synth"}:
        return  # they do what they are asked to, which takes its time
    (folder / "a.txt").write_text("1,2,3,4\n")
    before = Path.cwd()
    said = io.StringIO()
    os.chdir(folder)
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            code = main([word for word in words if word != "--debug"])
    finally:
        os.chdir(before)
    assert code in (0, 1, 2), code
    if code:
        last = said.getvalue().strip().splitlines()[-1]
        assert last.startswith("error: "), said.getvalue()
        assert "Traceback" not in said.getvalue()


def source_name(data: bytes, folder: Path) -> None:
    """Whatever is called a source: it is opened, or one sentence says why not."""
    name = _text(data).replace("://", ":")  # no network
    if name.isdecimal() and len(name) < 3:
        return  # a camera
    before = Path.cwd()
    os.chdir(folder)
    try:
        open_source(name).close()
    finally:
        os.chdir(before)


@cache
def _configs() -> tuple[Config, ...]:
    small = WindowConfig(size=64)
    return (
        Config(window=small),
        Config(window=WindowConfig(size=64, shape="box", border="mean", context=1.5)),
        Config(window=small, scale=ScaleConfig(steps=1), update=UpdateConfig(rate=1)),
    )


class _Numbers:
    """Numbers out of bytes; zeros when they are used up."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def byte(self) -> int:
        self._at += 1
        return self._data[self._at - 1] if self._at <= len(self._data) else 0

    @property
    def more(self) -> bool:
        return self._at < len(self._data)

    def number(self) -> float:
        special = (0.0, -1.0, 1e-9, 1e9, 1e300, -1e300, float("nan"), float("inf"), 0.5, 1.0)
        b = self.byte()
        return special[b - 246] if b >= 246 else (b - 40) * 0.75


_DTYPES = (
    np.uint8,
    np.uint16,
    np.float32,
    np.float64,
    np.bool_,
    np.int64,
    np.float16,
    np.complex64,
)


def _image(numbers: _Numbers) -> Any:
    """A frame as a careless caller may hand one in: any type, any shape, any content."""
    kind = numbers.byte()
    if kind >= 250:
        return (None, "frame", [[1, 2], [3]], {}, np.zeros(0), np.array([object()]))[kind - 250]
    size = ((48, 64), (2, 2), (1, 9), (3, 700), (90, 70), (48, 64))[kind % 6]
    channels = ((3,), (), (1,), (4,), (2,), (3,), (3,), (3,))[numbers.byte() % 8]
    dtype = _DTYPES[numbers.byte() % 8 if kind >= 200 else 0]
    content = numbers.byte()
    rng = np.random.default_rng(content)
    if content < 60:
        image = np.full((*size, *channels), content * 4 + (content > 50) * 19)
    elif content < 250:
        image = rng.integers(0, 256, (*size, *channels))
    else:
        image = np.full((*size, *channels), (np.nan, np.inf, -np.inf, 1e30, -1, 0)[content - 250])
    with np.errstate(all="ignore"):
        return image.astype(dtype)[:: 1 if content % 3 else -1]


def tracker(data: bytes, folder: Path) -> None:
    """Any calls in any order with any frames and boxes: every answer is finite and in its limits.

    The centre is in the frame, the size within `limits` of the first one, the score in [0, 1].
    """
    numbers = _Numbers(data)
    config = _configs()[numbers.byte() % 3]
    followed = Tracker(config, Means())
    for _ in range(200):
        if not numbers.more:
            break
        call = numbers.byte() % 8
        with contextlib.suppress(EntrackError):
            if call < 4:
                image = _image(numbers)
                for estimate in followed.update_many(image):
                    _check(estimate, *image.shape[:2])
            elif call == 4:
                followed.init(_image(numbers), [numbers.number() for _ in range(4)])
            elif call == 5:
                count = numbers.byte() % 3
                boxes = [[numbers.number() for _ in range(4)] for _ in range(count)]
                followed.init_many(_image(numbers), boxes)
            elif call == 6:
                followed.add([numbers.number() for _ in range(numbers.byte() % 2 + 3)])
            else:
                followed.drop(numbers.byte() % 4)


def _check(estimate: Any, height: int, width: int) -> None:
    box = estimate.box
    assert np.isfinite(box).all() and (box[2:] > 0).all(), box
    x, y = boxes_.centre(box)
    slack = 1e-6 * max(width, height)
    assert -slack <= x <= width + slack and -slack <= y <= height + slack, (box, width, height)
    assert 0 <= estimate.score <= 1 and np.isfinite(estimate.search).all()
    assert isinstance(bool(estimate.lost), bool) and np.isfinite(estimate.ms)


TARGETS: dict[str, tuple[Target, int]] = {
    "box": (box_string, 20),
    "table": (table, 20),
    "vot-text": (vot_text, 8),
    "vot-binary": (vot_binary, 8),
    "scores": (scores, 12),
    "list": (clip_list, 6),
    "toml": (configuration, 6),
    "json": (annotations, 6),
    "dataset": (dataset, 3),
    "results": (results, 3),
    "picture": (picture, 3),
    "model": (model_folder, 4),
    "policy": (policy, 2),
    "command": (command_line, 1),
    "source": (source_name, 3),
    "tracker": (tracker, 8),
}
"""Name → function, and its share of the executions: the quicker, the more."""


def seeds(name: str) -> list[bytes]:
    """Good inputs to begin with."""
    toml = b'[window]\ncontext = 3.0\nshape = "box"\n[scale]\nsteps = 3\n[score]\nbias = -1.5\n'
    rows = b"1,2,30,40\n2,3,30,40\nnan,nan,nan,nan\n"
    ok, png = cv2.imencode(".png", np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
    jpg = cv2.imencode(".jpg", np.full((8, 8, 3), 90, np.uint8))[1].tobytes()
    bmp = cv2.imencode(".bmp", np.full((3, 3, 3), 90, np.uint8))[1].tobytes()
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("baseline/bag/bag_001.txt", "1\n1,2,3,4\n")
    run = trajectory.read_text("1\n0,0,2,2\n2\n0\n1,1,5,1,5,5,1,5\n", "")
    assert ok
    known: dict[str, list[bytes]] = {
        "box": [b"10,20,30,40", b"1e3, -2.5,3,4", b"nan,inf,1,1"],
        "table": [b"\0" + rows, b"\x01" + b"1 2 3 4 5 6 7 8\n" * 3, b"\x02" + b"0\n1\n0\n"],
        "vot-text": [b"1\n0,0,2,2\n2\n0\n1,1,5,1,5,5,1,5\n", b"1e9,1e9,1e9,1e9\n"],
        "vot-binary": [trajectory.write_binary(run)],
        "scores": [b"score,lost\n\n0.5,0\n,1\n", b'score\n"0.5\n'],
        "list": [b"source,x,y,w,h,name,start,stop\na.mp4,1,2,3,4,a/b,0,9\na.mp4,1,2,3,4,a/b,0,9\n"],
        "toml": [toml],
        "json": [json.dumps({"Basketball": {"gt_rect": [[1, 2, 3, 4]], "absent": [1]}}).encode()],
        "dataset": [
            b"\x1e".join([rows, b"0,0,1", b"0,0,1", b"a\nbag\n"]) + bytes([k]) for k in range(6)
        ]
        + [
            b"\x1e".join([rows, png.tobytes(), b"width=4\nheight=4"]) + bytes([k]) for k in range(6)
        ],
        "results": [
            b"1\n1,2,3,4\n\x1e0.1\n0.2\n\x1escore\n0.5\n\n\x1e0.5\n",
            b"Z" + packed.getvalue(),
        ],
        "picture": [png.tobytes(), jpg, bmp],
        "model": [(load_model("cf").folder / "model.toml").read_bytes(), _toml_of_policy()],
        "policy": [_small_policy()],
        "command": [bytes([0, 13, 14, 43]), bytes([1, 32, 33, 36, 37, 19, 20]), bytes([3, 4, 33])],
        "source": [b"a.mp4", b"*.jpg", b"12345678901", b"[", b".", b"-1"],
        "tracker": [
            bytes([0, 4, 0, 0, 0, 100, 60, 60, 80, 80] + [0, 0, 0, 0, 100] * 4),
            bytes([1, 5, 2, 50, 50, 70, 70, 60, 60, 90, 90, 0, 0, 0, 120] + [0, 4, 0, 0, 90] * 3),
        ],
    }
    return known[name]


def _toml_of_policy() -> bytes:
    import hashlib

    def entry(kind: str, name: str, content: bytes) -> str:
        digest = hashlib.sha256(content).hexdigest()
        return f'[files.{kind}]\npath = "{name}"\nsha256 = "{digest}"\n'

    files = entry("trunk", "trunk.onnx", b"trunk") + entry(
        "policy", "policy.safetensors", b"policy"
    )
    return f'name = "a"\ndescription = "b"\n{files}[config.policy]\nf1 = "linear"\n'.encode()


def _small_policy() -> bytes:
    """A file of the right form, and small, so that a changed byte is likely to matter."""
    from safetensors.numpy import save

    path = load_model("policy").policy
    assert path is not None
    from safetensors.numpy import load_file

    return save({name: w[..., :4] for name, w in load_file(path).items()})
