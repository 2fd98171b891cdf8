"""Make docs/assets/web-*.jpg, every state of the page in each size and scheme, and way.jpg.

python scripts/make_screenshots.py            # needs the extra web, playwright, and Chromium
"""

import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
from playwright.sync_api import sync_playwright

from entrack.cli.app import main as entrack
from entrack.model import assets
from entrack.video import VideoWriter, open_source

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from web_page import ARGUMENTS, CHROMIUM, Hands, running, served  # noqa: E402

OUT = ROOT / "docs" / "assets"
SIZE = (640, 360)
CUPS = ((148, 153, 102, 94), (286, 153, 102, 94))
FRAME = "document.querySelector('.place').innerText.split(' ')[1]"
SCREENS = {
    "desktop": {"viewport": {"width": 1280, "height": 860}},
    "phone": {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True},
}


def clip_that_cuts(path: Path) -> Path:
    """The demo clip's first second, then another scene: whatever was tracked is lost."""
    with open_source(assets() / "demo" / "clip.mp4", stop=45) as source, VideoWriter(path) as video:
        for frame in source:
            other = frame.index >= 30
            image = cv2.GaussianBlur(cv2.flip(frame.image, 0), (0, 0), 30) if other else frame.image
            video.write(image, frame.time)
    return path


def states(hands: Hands, clip: Path, shot: Callable[[str], None]) -> None:
    """Walk through the page, and take its picture in every state."""
    page = hands.page
    shot("start")
    hands.upload({"name": "notes.mp4", "mimeType": "video/mp4", "buffer": b"not a video"})
    hands.wait_for(".error:has-text('not a video')")
    shot("refused")
    hands.upload(str(clip))
    hands.wait_for_video()
    page.wait_for_timeout(300)
    shot("first-frame")
    at = page.locator(".stage").bounding_box()
    x, y, w, h = (side * at["width"] / SIZE[0] for side in CUPS[0])
    page.mouse.move(at["x"] + x, at["y"] + y)
    page.mouse.down()
    page.mouse.move(at["x"] + x + 0.8 * w, at["y"] + y + 0.7 * h)
    hands.wait_for(".box.drawn")
    shot("drawing")
    page.mouse.move(at["x"] + x + w, at["y"] + y + h)
    page.mouse.up()
    hands.wait_for(".object")
    hands.click("Add an object")
    hands.wait_for(".message:has-text('another')")
    shot("adding")
    hands.drag(CUPS[1], SIZE)
    page.wait_for_function("document.querySelectorAll('.object').length === 2")
    hands.click("Track")
    page.wait_for_function(f"Number({FRAME}) > 8")
    shot("tracking")
    hands.wait_for(".track:has-text('Track')")
    page.wait_for_timeout(400)
    shot("lost")
    hands.seek(0.6)
    page.wait_for_timeout(400)
    shot("tracked")


def sigma(hands: Hands, shot: Callable[[str], None]) -> None:
    """A model that says how sure it is."""
    hands.click("Try the example")
    hands.wait_for_video()
    hands.drag(CUPS[0], SIZE)
    hands.click("Track")
    hands.page.wait_for_function(f"Number({FRAME}) > 30")
    hands.click("Pause")
    hands.wait_for(".track:has-text('Track')")
    shot("sigma")


def selecting(browser: Any, scheme: str) -> None:
    """The page of `entrack track --select`."""
    clip = str(assets() / "demo" / "clip.mp4")
    call = [sys.executable, "-m", "entrack", "track", clip, "--select", "--stop", "2"]
    with running(call) as (_, address):
        page = browser.new_page(**SCREENS["desktop"], color_scheme=scheme)
        hands = Hands(page, address, ready=".stage")
        hands.wait_for_video()
        hands.drag(CUPS[0], SIZE)
        shoot(page, "desktop", scheme, "select")
        hands.click("Track")
        hands.wait_for("h2:has-text('goes on in the terminal')")
        page.close()


def way_of_a_frame(folder: Path) -> None:
    """What `entrack explain` makes of a frame of the demo clip, small enough for a page."""
    clip, box = str(assets() / "demo" / "clip.mp4"), ",".join(map(str, CUPS[0]))
    entrack(["explain", clip, "--box", box, "--frame", "40", "--out", str(folder / "way.png")])
    large = cv2.imread(str(folder / "way.png"))
    assert large is not None
    small = cv2.resize(large, None, fx=0.7, fy=0.7, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(OUT / "way.jpg"), small, [cv2.IMWRITE_JPEG_QUALITY, 88])


def main() -> None:
    with (
        tempfile.TemporaryDirectory() as folder,
        served(Path(folder)) as address,
        served(Path(folder), "--model", "policy") as unsure,
        sync_playwright() as playwright,
    ):
        way_of_a_frame(Path(folder))
        clip = clip_that_cuts(Path(folder) / "cups.mp4")
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=ARGUMENTS)
        for screen, options in SCREENS.items():
            for scheme in ("light", "dark"):
                page = browser.new_page(**options, color_scheme=scheme)
                states(Hands(page, address), clip, partial(shoot, page, screen, scheme))
                page.context.close()
        for scheme in ("light", "dark"):
            page = browser.new_page(**SCREENS["desktop"], color_scheme=scheme)
            sigma(Hands(page, unsure), partial(shoot, page, "desktop", scheme))
            selecting(browser, scheme)


def shoot(page: Any, screen: str, scheme: str, state: str) -> None:
    out = OUT / f"web-{state}-{screen}-{scheme}.jpg"
    page.screenshot(path=out, type="jpeg", quality=78, full_page=screen == "phone")
    print(f"{out.name}: {out.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
