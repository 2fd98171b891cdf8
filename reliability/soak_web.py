"""Eight visitors of the web page at once: none is lost, none sees what is another's.

    python -m reliability.soak_web [--sessions 8] [--minutes 15]

Every visitor has a video of a colour of its own, and does the same again and again: upload it, draw
a box, press Track, wait for the end, take the CSV home, ask for another video. Every picture that
arrives has to be of the visitor's colour, and every CSV what the tracker says of the visitor's
video.
"""

import asyncio
import base64
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import entrack
from entrack.boxfiles import BoxWriter
from entrack.run import follow
from entrack.video import VideoWriter, open_source
from reliability.figures import parser, tell
from reliability.soak import resident
from reliability.visitor import Visitor, labelled, of_class

_SIZE = (160, 120)
_BOX = (40, 40, 32, 32)


def clip(path: Path, number: int, frames: int) -> None:
    """A textured square that moves over a ground of colour `number`."""
    rng = np.random.default_rng(number)
    square = rng.integers(0, 256, (32, 32, 3), np.uint8)
    square = cv2.blur(square, (5, 5))
    with VideoWriter(path, 25) as video:
        for t in range(frames):
            image = np.empty((_SIZE[1], _SIZE[0], 3), np.uint8)
            image[:] = colour(number)
            x, y = 40 + round((20 + 4 * number) * np.sin(t / 20)), 40 + number % 3 * (t % 20) // 4
            image[y : y + 32, x : x + 32] = square
            video.write(image, t / 25)


def colour(number: int) -> np.ndarray:
    """BGR of a visitor: a corner of the cube of colours, a little inside."""
    return np.array([40 + 170 * (number >> k & 1) for k in range(3)], np.uint8)


def boxes(text: str) -> np.ndarray:
    """Boxes of a CSV."""
    rows = [line.split(",") for line in text.splitlines()[1:]]
    return np.array([[float(cell) for cell in row[3:7]] for row in rows])


def expected(path: Path) -> np.ndarray:
    """What the tracker says of a clip."""
    tracker = entrack.load("default", threads=1)
    table = path.with_suffix(".csv")
    with open_source(path) as source, BoxWriter(table) as writer:
        for frame, estimates in follow(tracker, source, [_BOX]):
            writer.write(frame, estimates)
    return boxes(table.read_text())


async def visit(
    number: int, path: Path, truth: np.ndarray, address: str, until: float
) -> dict[str, Any]:
    """Work with one page until a time; return what was done and what was wrong."""
    done: dict[str, Any] = {"rounds": 0, "pictures": 0, "wrong": []}
    content = path.read_bytes()

    def look(source: str) -> None:
        data = np.frombuffer(base64.b64decode(source.partition("base64,")[2]), np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_COLOR)
        if image is not None and image.shape[1] == _SIZE[0]:
            done["pictures"] += 1
            if np.abs(image[:8, :8].mean((0, 1)) - colour(number)).max() > 12:
                done["wrong"].append(f"visitor {number} sees a picture of another")

    x, y, w, h = _BOX
    ends = x / _SIZE[0], y / _SIZE[1], (x + w) / _SIZE[0], (y + h) / _SIZE[1]
    try:
        async with Visitor(address) as visitor:
            visitor.on_picture = look
            while time.monotonic() < until or not done["rounds"]:
                assert await visitor.upload(f"{number}.mp4", content) == 200
                await visitor.until(lambda: visitor.sees(of_class("stage")))
                await visitor.drag(ends)
                await visitor.until(lambda: _enabled(visitor, of_class("track")))
                await visitor.press(of_class("track"))
                last = f"frame {len(truth) - 1} of {len(truth) - 1}"
                await visitor.until(
                    lambda: (
                        any(t.startswith(last) for t in visitor.texts)  # noqa: B023
                        and visitor.sees(labelled("Track"))
                    ),
                    900,
                )
                found = boxes((await visitor.fetch("CSV")).decode())
                if found.shape != truth.shape or np.abs(found - truth).max() > 0.01:
                    done["wrong"].append(f"visitor {number} gets boxes of something else")
                await visitor.press(labelled("Another video"))
                await visitor.until(lambda: not visitor.sees(of_class("stage")))
                done["rounds"] += 1
            done["wrong"] += [f"visitor {number} was told {note}" for note in visitor.notes]
    except Exception as error:
        done["wrong"].append(f"visitor {number} was lost: {type(error).__name__} {error}")
    return done


def _enabled(visitor: Visitor, test: Any) -> bool:
    return not visitor.find(test)[1]["props"].get("disable")


@contextmanager
def served(*options: str, **variables: str) -> Generator[tuple[str, int], None, None]:
    """Run `entrack serve`; yield its address and its process."""
    call = [sys.executable, "-m", "entrack", "serve", "--no-show", "--port", "0", *options]
    # NiceGUI changes what it does where it sees pytest's variables.
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
    with subprocess.Popen(
        call, stderr=subprocess.PIPE, text=True, env={**clean, **variables}
    ) as process:
        assert process.stderr is not None
        said = process.stderr.readline()
        # Who does not read what it says holds it up.
        threading.Thread(target=process.stderr.read, daemon=True).start()
        try:
            yield next(word for word in said.split() if word.startswith("http")), process.pid
        finally:
            process.terminate()


async def answering(address: str, seconds: float = 120) -> None:
    """Wait until a server does that."""
    import aiohttp

    async with asyncio.timeout(seconds), aiohttp.ClientSession() as session:
        while True:
            try:
                async with session.get(f"{address}/favicon.ico"):
                    return
            except aiohttp.ClientConnectionError:
                await asyncio.sleep(0.2)


async def soak(
    sessions: int, minutes: float, frames: int, folder: Path
) -> tuple[dict[str, Any], list[str]]:
    """Let visitors work; return figures, and what was not as promised."""
    paths = [folder / f"{number}.mp4" for number in range(sessions)]
    for number, path in enumerate(paths):
        clip(path, number, frames)
    truths = [expected(path) for path in paths]
    with served("--threads", "1") as (address, pid):
        await answering(address)
        began = time.monotonic()
        until = began + 60 * minutes
        memory = resident(pid)
        calls = [visit(n, paths[n], truths[n], address, until) for n in range(sessions)]
        found = await asyncio.gather(*calls)
        figures = {
            "sessions": sessions,
            "minutes": round((time.monotonic() - began) / 60, 1),
            "rounds": sum(f["rounds"] for f in found),
            "fewest_rounds": min(f["rounds"] for f in found),
            "pictures": sum(f["pictures"] for f in found),
            "mb_before": round(memory, 1),
            "mb_after": round(resident(pid), 1),
        }
    return figures, [sentence for f in found for sentence in f["wrong"]]


def main() -> int:
    words = parser(__doc__)
    words.add_argument("--sessions", type=int, default=8)
    words.add_argument("--minutes", type=float, default=15)
    words.add_argument("--frames", type=int, default=150)
    given = words.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = soak(given.sessions, given.minutes, given.frames, Path(folder))
        return tell("soak_web", *asyncio.run(work), given.out)


if __name__ == "__main__":
    sys.exit(main())
