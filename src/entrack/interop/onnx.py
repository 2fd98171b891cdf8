"""`entrack export`: a model as two ONNX files that run without entrack.

`trunk.onnx` makes features of patches; `step.onnx` is all that follows until the box, as a pure
function: what is remembered goes in, and comes out. The first frame needs no graph of its own: a
memory of zeros means that there was none.
"""
# pyright: basic

import json
import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch

from entrack.errors import EntrackError, require
from entrack.files import unfinished, write_bytes
from entrack.interop.step import Step
from entrack.likeness import FINER
from entrack.model import Model, assets
from entrack.policy import load_policy
from entrack.state import GRID
from entrack.tracker import PLACES
from entrack.trunk import for_onnxruntime
from entrack.trunks.dequantise import dequantise

Shape = tuple[int, ...]


def export_model(model: Model, out: Path, precision: str = "model") -> list[Path]:
    """Write trunk.onnx, step.onnx, model.json, track.py and README.md into `out`.

    With `precision` "fp32" a quantised trunk becomes float.

    Raises
    ------
    EntrackError
        If the model saves passes of the trunk in a way that the exported step does not know.
    """
    require("onnx", "train")
    every = model.config.update.every
    if every != 1:
        raise EntrackError(f"{model.name} has update.every = {every}; only 1 can be exported")
    out.mkdir(parents=True, exist_ok=True)
    policy = None
    if model.policy and model.config.policy:
        policy = load_policy(model.policy, model.config.policy)
    z, fine = _maps(model.trunk, model.config.window.size)
    channels = z[0]
    step = Step(model.config, policy)
    _write_step(step, z, fine, out / "step.onnx")
    trunk = dequantise(model.trunk) if precision == "fp32" else for_onnxruntime(model.trunk)
    write_bytes(out / "trunk.onnx", trunk)
    config = model.config
    half = config.scale.steps // 2
    facts = {
        "model": model.name,
        "checksum": model.checksum,
        "size": config.window.size,
        "context": config.window.context,
        "square": config.window.shape == "square",
        "border": config.window.border,
        "again": config.update.seen == "again",
        "zooms": (config.scale.factor ** np.arange(-half, half + 1.0)).tolist(),
    }
    write_bytes(out / "model.json", (json.dumps(facts, indent=1) + "\n").encode())
    texts = assets() / "export"
    shutil.copyfile(texts / "track.py.txt", out / "track.py")
    card = (texts / "README.md.txt").read_text()
    text = card.format(
        name=model.name, size=config.window.size, n=step.n, c=channels, k=config.scale.steps,
        fine=_FINE.format(f=fine[0], m=fine[1]) if fine != z else "",
        memory="".join(_MEMORY[name] for name in step.remembered if name in _MEMORY).format(
            k=config.scale.steps, size=config.window.size, c=channels, f=fine[0], m=fine[1]), sigma=_SIGMA if policy else "", places=PLACES,
        without=_WITHOUT if config.recovery else "",
    )  # fmt: skip
    write_bytes(out / "README.md", text.encode())
    return [out / n for n in ("trunk.onnx", "step.onnx", "model.json", "track.py", "README.md")]


def _maps(trunk: Path, size: int) -> tuple[Shape, Shape]:
    """Shapes (C, n, n) of Z and of the finer map, which is Z where a trunk has no other."""
    import onnxruntime as ort

    session = ort.InferenceSession(str(trunk), providers=["CPUExecutionProvider"])
    patch = np.zeros((1, 3, size, size), np.float32)
    found: Any = session.run(None, {session.get_inputs()[0].name: patch})
    return found[0].shape[1:], found[-1].shape[1:]


def _write_step(step: Step, z: Shape, fine: Shape, path: Path) -> None:
    k, side, colour = step.config.scale.steps, step.config.window.size, step.config.colour
    shapes = {
        "features": (1 + k, *z), "box": (4,), "image": (2,), "first_size": (2,),
        "template": z, "score": (), "first": z, "roi": (4,), "past": (4,),
        "turn": (), "patches": (1 + k, 3, side, side), "colours": (4, colour.bins**3 if colour else 1),
        "tint": (5,), "aspect": (), "fine": (1 + k, *fine), "first_fine": fine,
        "inside": (z[0], GRID, GRID), "inside_fine": (fine[0], FINER, FINER),
        "last_fine": fine, "last_roi": (4,),
    }  # fmt: skip
    outputs = ["box_out", "told"] + (["sigma"] if step.policy else [])
    outputs += [f"{m}_out" for m in step.remembered]
    values = tuple(torch.rand(shape) for shape in shapes.values())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            step.eval(), values, str(unfinished(path)), input_names=list(shapes),
            output_names=outputs, opset_version=17, dynamo=False,
        )  # fmt: skip
    unfinished(path).replace(path)


_MEMORY = {
    "first": "| `first` | `first_out` | Z of the first frame's window |\n",
    "roi": "| `roi` | `roi_out` | float32 (4,): the first box in that window, x, y, w, h in shares of "
    "its side |\n",
    "past": "| `past` | `past_out` | float32 (4,): what the score remembers: how the target moves in a "
    "frame, x and y in pixels; the greatest leap; how restless it is |\n",
    "turn": "| `turn` | `turn_out` | float32 (): frames until other sizes than the last are looked at; "
    "above 0, `features` of the other `zooms` are not used |\n",
    "colours": "| `patches` | | float32 ({k} + 1, 3, {size}, {size}): what the trunk saw for `features` |\n"
    "| `colours` | `colours_out` | float32 (4, bins³): shares of the target's colours in the first frame, "
    "running means of them and of those around it, and how much a pixel of each was the target's |\n",
    "tint": "| `tint` | `tint_out` | float32 (5,): the target's tint, how much it varies, and the frames in "
    "which both were learned |\n",
    "first_fine": "| `fine` | | float32 ({k} + 1, {f}, {m}, {m}): what the trunk's second output has for `features`; Z again if it has none |\n"
    "| `first_fine` | `first_fine_out` | the same of the first frame's window |\n",
    "inside": "| `inside` | `inside_out` | float32 ({c}, 8, 8): a running mean of what the features in the box "
    "have beyond the mean of the first frame's window |\n",
    "inside_fine": "| `inside_fine` | `inside_fine_out` | float32 ({f}, 12, 12): the same of `fine` |\n",
    "last_fine": "| `last_fine` | `last_fine_out` | `fine` of the last frame's window … |\n",
    "last_roi": "| `last_roi` | `last_roi_out` | float32 (4,): … and the box in it, in shares of its side |\n",
    "aspect": "| `aspect` | `aspect_out` | float32 (): by what logarithm the target seems to be wider than its first "
    "box, a running mean; `told` is stretched by it |\n",
}
_FINE = "; and float32 (N, {f}, {m}, {m}), what it saw on the way there"
_SIGMA = """
`sigma`, float32 (4,): standard deviation of the left, top, right and bottom side, in units of the last box's size.
"""
_WITHOUT = """

What the model does when it is in doubt, `[config.recovery]`, is not in these files: they follow the target as the same model without it."""
