"""The bars of speed, each against something that is timed in the same run.

    python benchmarks/speed.py [--video FILE --box X,Y,W,H] [--reference MODEL] [--nanotrack DIR]

FILE is tracked by the command, decoding and encoding included; MODEL is a folder that `entrack
trunk import` made of ResNet-18. Prints a table; exit code 1 if a bar is missed.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import openvino as ov

import entrack
from entrack import bench
from entrack.model import load_model

THREADS = 2


def tracking(nanotrack: Path | None) -> list[tuple[str, float, float]]:
    """Frames a second in memory, and against other trackers."""
    others = ["opencv:csrt"] + ([f"opencv:nano:{nanotrack}"] if nanotrack else [])
    model = load_model("cf")
    peers = bench.contenders(model, THREADS, others)
    peers |= {name: entrack.load(name, threads=THREADS) for name in ("default", "longterm")}
    found = bench.trackers(peers, bench.demo(60), rounds=7)
    fps = {name: bench.summary(times)["fps"] for name, times in found.items()}
    one, three = fps["cf, one size, openvino"], fps["cf, three sizes, openvino"]
    rows = [
        ("default, frames/s", fps["default"], 120),
        ("longterm, times default", fps["longterm"] / fps["default"], 0.85),
        ("cf, one size, frames/s", one, 150),
        ("cf, three sizes, frames/s", three, 60),
        ("cf, one size, times CSRT", one / fps["opencv:csrt"], 1.5),
    ]
    if nanotrack:
        rows.append(("cf, one size, times NanoTrack", one / fps["opencv:nano"], 1))
    return rows


def command(video: Path, box: str) -> list[tuple[str, float, float]]:
    """Frames a second of `entrack track` with a video and a table as output."""
    with tempfile.TemporaryDirectory() as folder:
        outputs = ["--video", f"{folder}/out.mp4", "--boxes", f"{folder}/out.csv"]
        call = ["track", str(video), "--box", box, "--json", *outputs]
        done = subprocess.run(
            [sys.executable, "-m", "entrack", *call], check=True, capture_output=True, text=True
        )
    return [(f"entrack track {video.name}, frames/s", json.loads(done.stdout)["fps"], 25)]


def trunk(reference: Path) -> list[tuple[str, float, float]]:
    """One 288² patch on the shipped trunk against ResNet-18 to layer3 in fp32."""
    calls = {
        "ours": network(load_model("cf").trunk, {}),
        "reference": network(load_model(reference).trunk, {"INFERENCE_PRECISION_HINT": "f32"}),
    }
    ms = {name: float(np.median(times)) for name, times in bench.take_turns(calls, 100).items()}
    return [("trunk, times fp32 ResNet-18", ms["reference"] / ms["ours"], 8)]


def network(path: Path, options: dict[str, str]):
    """A call of one patch on all threads."""
    core = ov.Core()
    model = core.read_model(path)
    model.reshape([1, 3, 288, 288])
    steps = ov.preprocess.PrePostProcessor(model)
    steps.input().tensor().set_element_type(ov.Type.u8).set_layout(ov.Layout("NHWC"))
    steps.input().model().set_layout(ov.Layout("NCHW"))
    hints = {"NUM_STREAMS": 1, "INFERENCE_NUM_THREADS": THREADS, "ENABLE_CPU_PINNING": False}
    request = core.compile_model(steps.build(), "CPU", hints | options).create_infer_request()
    patch = np.random.default_rng(0).integers(0, 255, (1, 288, 288, 3), dtype=np.uint8)
    request.set_input_tensor(ov.Tensor(patch, shared_memory=True))
    return request.infer


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--video", type=Path)
    parser.add_argument("--box", default="125,180,137,167")
    parser.add_argument("--reference", type=Path)
    parser.add_argument("--nanotrack", type=Path)
    args = parser.parse_args()
    rows = tracking(args.nanotrack)
    rows += command(args.video, args.box) if args.video else []
    rows += trunk(args.reference) if args.reference else []
    for what, found, bar in rows:
        print(f"{what:34} {found:9.2f}   at least {bar:g}{'' if found >= bar else '   MISSED'}")
    return int(any(found < bar for _, found, bar in rows))


if __name__ == "__main__":
    sys.exit(main())
