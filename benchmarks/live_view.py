"""The web page's live view: frames shown a second, and the time from a click to its effect.

    python benchmarks/live_view.py [--load N] [--seconds S] [--video FILE --box X,Y,W,H]

Serves the page, tracks in a real Chromium, and counts pictures at the moment they are painted. With
`--load N` as many processes keep the machine busy meanwhile. Prints a table and, for each picture
shown, the processor's time that server and browser took. Exit code 1 if a bar is missed.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from entrack.model import assets
from entrack.video import open_source

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from web_page import ARGUMENTS, CHROMIUM, Hands, cpu, running  # noqa: E402

SHOWN, REACTION = 20, 300  # the bars: frames a second, milliseconds
WARM = 1.5  # seconds until the first frames are not counted any more
COUNT = """() => {
    const seen = window.painted = {first: null, last: null, count: 0};
    document.addEventListener('load', (event) => {
        if (event.target.closest?.('.stage')) requestAnimationFrame((now) => {
            seen.count += seen.last !== now;  // two in one frame are one that is seen
            seen.first ??= now;
            seen.last = now;
        });
    }, true);
}"""
REACT = """([event, effect]) => {
    const holds = new Function('before', `return ${effect}`);
    const state = () => ({
        place: document.querySelector('.place')?.innerText,
        source: document.querySelector('.stage img')?.src,
        boxes: document.querySelector('.boxes')?.innerHTML,
    });
    window.reaction = new Promise((done) => addEventListener(event, () => {
        const began = performance.now(), before = state();
        const look = () => holds(before)
            ? done(performance.now() - began) : requestAnimationFrame(look);
        requestAnimationFrame(look);
    }, {capture: true, once: true}));
}"""
BUTTON = "document.querySelector('.track').innerText.includes('{}')"
MOVED = """document.querySelector('.place').innerText !== before.place
    && document.querySelector('.stage img').src !== before.source
    && document.querySelector('.stage img').complete"""


@contextmanager
def busy(processes: int) -> Generator[None, None, None]:
    """Keep so many processors busy."""
    loop = [sys.executable, "-c", "while True: pass"]
    with ExitStack() as stack:
        for _ in range(processes):
            stack.callback(stack.enter_context(subprocess.Popen(loop)).kill)
        yield


def shown(hands: Hands, server: int, seconds: float) -> dict[str, float]:
    """Track for some seconds: rates, and processor milliseconds for each picture."""
    hands.click("Track")
    hands.wait_for(".track:has-text('Pause')")
    time.sleep(WARM)
    hands.page.evaluate(COUNT)
    began, first = time.monotonic(), hands.frame
    spent = -np.array([cpu(server), cpu(os.getpid(), without=server)])
    time.sleep(seconds)
    if "Pause" not in hands.page.locator(".track").inner_text():
        raise SystemExit("the video was over before the time was: give a longer one")
    pictures, last = hands.page.evaluate("[painted.count - 1, painted.last - painted.first]")
    spent += [cpu(server), cpu(os.getpid(), without=server)]
    tracked = (hands.frame - first) / (time.monotonic() - began)
    server_ms, browser_ms = 1e3 * spent / max(pictures, 1)
    return {
        "shown": 1e3 * pictures / last,
        "tracked": tracked,
        "server": server_ms,
        "browser": browser_ms,
    }


def reaction(page: Any, event: str, effect: str, act: Callable[[], object]) -> float:
    """Milliseconds from the event in the browser to the frame that shows the effect."""
    page.evaluate(REACT, [event, effect])
    act()
    return page.evaluate("window.reaction")


def reactions(hands: Hands, times: int) -> dict[str, list[float]]:
    """Every kind of click, some times each, most of them while tracking."""
    page = hands.page
    chart = page.locator(".chart > div").first.bounding_box()
    stage = page.locator(".stage").bounding_box()
    found: dict[str, list[float]] = {}

    def measure(name: str, event: str, effect: str, act: Callable[[], object]) -> None:
        found.setdefault(name, []).append(reaction(page, event, effect, act))

    def seek(share: float) -> None:
        page.mouse.click(chart["x"] + share * chart["width"], chart["y"] + 20)

    for turn in range(times):
        seek(0.1 + 0.02 * turn)
        page.wait_for_selector(".track:has-text('Track')")
        corner = (stage["x"] + stage["width"] * 0.24, stage["y"] + stage["height"] * 0.43)
        page.mouse.move(*corner)
        page.mouse.down()
        page.mouse.move(corner[0] + stage["width"] * 0.15, corner[1] + stage["height"] * 0.25)
        changed = "document.querySelector('.boxes').innerHTML !== before.boxes"
        measure("box drawn", "pointerup", changed, page.mouse.up)
        measure("Track", "click", BUTTON.format("Pause"), lambda: hands.click("Track"))
        time.sleep(0.7)
        measure("Pause", "click", BUTTON.format("Track"), lambda: hands.click("Pause"))
        measure("step on", "keydown", MOVED, lambda: page.keyboard.press("ArrowRight"))
        measure("step back", "keydown", MOVED, lambda: page.keyboard.press("ArrowLeft"))
        hands.click("Track")
        time.sleep(0.7)
        measure("go to another time, tracking", "click", MOVED, lambda: seek(0.05))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--load", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=4)
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("--video", default=str(assets() / "demo" / "clip.mp4"))
    parser.add_argument("--box", default="148,153,102,94")
    given = parser.parse_args()
    with open_source(given.video) as source:
        size = source.size
    box = tuple(map(float, given.box.split(",")))
    call = [sys.executable, "-m", "entrack", "serve", "--no-show", "--port", "0"]
    with (
        tempfile.TemporaryDirectory() as folder,
        busy(given.load),
        running(call, TMPDIR=folder) as (process, address),
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=ARGUMENTS)
        hands = Hands(browser.new_page(viewport={"width": 1280, "height": 900}), address)
        hands.upload(given.video)
        hands.wait_for_video()
        hands.drag(box, size)
        rates = shown(hands, process.pid, given.seconds)
        clicks = reactions(hands, given.times)
        load = os.getloadavg()[0]
        browser.close()
    print(f"{size[0]}×{size[1]}, load average {load:.1f}, {os.cpu_count()} cores")
    print(f"{rates['shown']:.1f} frames/s shown of {rates['tracked']:.1f} tracked")
    print(f"a picture shown: {rates['server']:.0f} ms of server, {rates['browser']:.0f} of browser")
    print(f"{'milliseconds from … to its effect':34}{'median':>8}{'95 %':>8}{'worst':>8}")
    for name, times in clicks.items():
        print(f"{name:34}" + "".join(f"{np.quantile(times, q):8.0f}" for q in (0.5, 0.95, 1)))
    slowest = max(np.quantile(times, 0.95) for times in clicks.values())
    return int(rates["shown"] < SHOWN or slowest > REACTION)


if __name__ == "__main__":
    sys.exit(main())
