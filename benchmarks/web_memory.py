"""Ten minutes of using the web page, and whether the memory of server or browser grows.

    python benchmarks/web_memory.py [--minutes M]

A user in a real Chromium tracks, pauses, goes back, corrects, adds and removes objects, downloads,
and takes another video, over and over. Prints the memory each half minute, and what a minute adds
after the first quarter of the time, when caches are full. Exit code 1 if a minute adds more than
1 MB to either.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from web_page import ARGUMENTS, CHROMIUM, Hands, running  # noqa: E402

SIZE, CUPS = (640, 360), ((148, 153, 102, 94), (286, 153, 102, 94))
BAR = 1.0  # MB a minute


def resident(pid: int) -> float:
    """Memory of a process that is no file's, MB."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("RssAnon"):
            return int(line.split()[1]) / 1e3
    raise SystemExit(f"no process {pid}")


def use(hands: Hands, folder: Path) -> None:
    """Do once all that can be done with a video."""
    page = hands.page
    hands.click("Try the example")
    hands.wait_for_video()
    hands.drag(CUPS[0], SIZE)
    hands.click("Track")
    time.sleep(4)
    hands.click("Pause")
    hands.wait_for(".track:has-text('Track')")
    hands.seek(0.05)
    hands.drag(CUPS[0], SIZE)
    hands.click("Add an object")
    hands.wait_for(".message:has-text('another object')")
    hands.drag(CUPS[1], SIZE)
    page.wait_for_function("document.querySelectorAll('.object').length === 2")
    hands.track()
    hands.download("CSV", folder).unlink()
    hands.click("Remove object 1")
    page.wait_for_function("document.querySelectorAll('.object').length === 1")
    hands.click("Another video")
    hands.wait_for(".drop")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10)
    minutes = parser.parse_args().minutes
    call = [sys.executable, "-m", "entrack", "serve", "--no-show", "--port", "0"]
    rows: list[tuple[float, float, float]] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        running(call, TMPDIR=folder) as (process, address),
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=ARGUMENTS)
        hands = Hands(browser.new_page(viewport={"width": 1280, "height": 900}), address)
        devtools = hands.page.context.new_cdp_session(hands.page)
        began, rounds = time.monotonic(), 0
        while (passed := (time.monotonic() - began) / 60) < minutes:
            use(hands, Path(folder))
            rounds += 1
            devtools.send("HeapProfiler.collectGarbage")
            heap = devtools.send("Runtime.getHeapUsage")["usedSize"] / 1e6
            rows.append((passed, resident(process.pid), heap))
            if rounds == 1 or int(2 * passed) > int(2 * rows[-2][0]):
                server = f"server {rows[-1][1]:7.1f} MB"
                print(f"{passed:5.1f} min  {server}  page {heap:6.1f} MB", flush=True)
        browser.close()
    late = np.array([row for row in rows if row[0] >= minutes / 4])
    growth = np.polyfit(late[:, 0], late[:, 1:], 1)[0]
    print(f"{rounds} rounds in {minutes:g} minutes, {hands.complaints or 'no'} complaints")
    print(f"a minute adds {growth[0]:+.2f} MB to the server, {growth[1]:+.2f} MB to the page")
    return int(growth.max() > BAR)


if __name__ == "__main__":
    sys.exit(main())
