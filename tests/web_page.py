"""A served page in a real browser, and a user's hands on it."""

import os
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

CHROMIUM = Path("/usr/bin/chromium")
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--use-fake-device-for-media-stream",
    "--use-fake-ui-for-media-stream",
]


@contextmanager
def served(folder: Path, *options: str) -> Generator[str, None, None]:
    """Run `entrack serve` with its temporary files in `folder`; yield its address."""
    call = [sys.executable, "-m", "entrack", "serve", "--no-show", "--port", "0", *options]
    with running(call, TMPDIR=str(folder)) as (_, address):
        yield address


@contextmanager
def running(
    call: list[str], **variables: str
) -> Generator[tuple[subprocess.Popen[str], str], None, None]:
    """Run a program that serves a page; yield it and the address that it says first."""
    # NiceGUI changes what it does where it sees pytest's variables.
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
    with subprocess.Popen(
        call, stderr=subprocess.PIPE, text=True, env={**clean, **variables}
    ) as process:
        assert process.stderr is not None
        said = process.stderr.readline()
        try:
            yield process, next(word for word in said.split() if word.startswith("http"))
        finally:
            process.terminate()


def cpu(root: int, without: int = 0) -> float:
    """Seconds of processor time of a process and all that it started, but for one branch."""
    parents: dict[int, int] = {}
    used: dict[int, float] = {}
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        parents[int(entry.name)] = int(fields[1])
        used[int(entry.name)] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def below(pid: int) -> bool:
        while pid not in (root, without, 0):
            pid = parents.get(pid, 0)
        return pid == root

    return sum(seconds for pid, seconds in used.items() if below(pid))


class Hands:
    """What a user does on one page."""

    def __init__(self, page: Any, address: str, ready: str = ".drop") -> None:
        self.page = page
        self.complaints: list[str] = []
        page.set_default_timeout(120_000)  # a busy machine is no error
        page.on("console", self._listen)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self._open(address)
        self.wait_for(ready)

    def _open(self, address: str) -> None:
        for wait in (0.2, 0.5, 1, 2, 4, 8):  # the server says its address before it answers
            try:
                self.page.goto(address)
                break
            except Exception:
                time.sleep(wait)

    def _listen(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.complaints.append(message.text)

    def upload(self, file: Any) -> None:
        self.page.set_input_files("input[type=file]", file)

    def wait_for_video(self) -> None:
        self.page.wait_for_function("document.querySelector('.stage img')?.naturalWidth > 0")

    def drag(self, box: Any, size: tuple[int, int]) -> np.ndarray:
        """Draw a box in the video's pixels; return what the mouse, in whole pixels, drew."""
        at = self.page.locator(".stage").bounding_box()
        corner, side = np.array([at["x"], at["y"]]), np.array([at["width"], at["height"]])
        box = np.asarray(box, float)
        ends = [np.round(p / size * side + corner) for p in (box[:2], box[:2] + box[2:])]
        mouse, known = self.page.mouse, self.page.locator(".object").count()
        mouse.move(*ends[0])
        mouse.down()
        mouse.move(*np.mean(ends, axis=0))
        mouse.move(*ends[1])
        mouse.up()
        low, high = [(end - corner) / side * size for end in ends]
        self.page.wait_for_function(
            "n => document.querySelectorAll('.boxes .box:not(.drawn)').length >= n",
            arg=max(known, 1),
        )
        return np.concatenate([low, high - low])

    def wait_for(self, selector: str) -> None:
        """Wait until something like it is there; no handle stays, which would keep it alive."""
        self.page.locator(selector).first.wait_for()

    def click(self, text: str) -> None:
        self.page.get_by_role("button", name=text, exact=True).click()

    def track(self) -> None:
        """Press Track and wait until it has come to the end."""
        self.click("Track")
        self.wait_for(".track:has-text('Pause')")
        self.wait_for(".track:has-text('Track')")

    def seek(self, share: float) -> int:
        """Click into the curve; return the frame."""
        chart = self.page.locator(".chart > div").first.bounding_box()
        before = self.place
        self.page.mouse.click(chart["x"] + share * chart["width"], chart["y"] + 20)
        self.page.wait_for_function(
            "old => document.querySelector('.place').innerText !== old", arg=before
        )
        return self.frame

    @property
    def place(self) -> str:
        return self.page.locator(".place").inner_text()

    @property
    def frame(self) -> int:
        """Number of the frame that is looked at."""
        return int(self.place.split()[1])

    def download(self, kind: str, folder: Path) -> Path:
        with self.page.expect_download() as started:
            self.click(kind)
        path = folder / started.value.suggested_filename
        started.value.save_as(path)
        return path
