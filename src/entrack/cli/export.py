"""`entrack export`."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from entrack.cli.console import checking_call, new_app
from entrack.errors import require
from entrack.files import writing

app = new_app()


@app.command()
def export(
    model: Annotated[str, typer.Argument(metavar="MODEL", help="Name of a model, or its folder.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the files.")],
    precision: Annotated[
        Literal["model", "fp32"],
        typer.Option(
            help="fp32: an int8 trunk in float, slower, with the boxes that the Python tracker has "
            "at that precision, whatever its engine."
        ),
    ] = "model",
) -> None:
    """Write a model as two ONNX files that run in ONNX Runtime, without entrack.

    \b
    entrack export policy --out exported
    python exported/track.py video.mp4 125,180,137,167

    DIR gets trunk.onnx, step.onnx (filter and policy, a pure function), model.json, track.py (an
    example that needs numpy, OpenCV and onnxruntime alone), and README.md: all inputs and outputs.
    """  # noqa: D301
    from entrack.model import load_model

    with checking_call():
        opened = load_model(model)
    for module in ("torch", "onnx", "onnxruntime"):
        require(module, "train")
    from entrack.interop.onnx import export_model

    with writing(out):
        paths = export_model(opened, out, precision)
    for path in paths:
        typer.echo(f"wrote {path}")
