"""One page: choose a video, then work on it. Nothing is shared with another page."""

import asyncio
import secrets
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

from nicegui import app, ui
from starlette.requests import Request
from starlette.responses import Response

import entrack
from entrack.errors import EntrackError
from entrack.video import Clip
from entrack.web.camera import Recording
from entrack.web.session import Footage, Session
from entrack.web.start import Start
from entrack.web.workbench import Workbench

_STYLE = (Path(__file__).parent / "page.css").read_text("utf-8")
_PICTURE = 8_000_000  # bytes of the largest frame of a camera

PAGES: dict[str, "Page"] = {}
"""The open pages by their secret keys."""


@dataclass(frozen=True)
class Settings:
    """What `entrack serve` was told."""

    folder: Path
    """For uploads and downloads; each page has a folder of its own in it."""
    model: str = "default"
    threads: int | None = None
    megabytes: int = 1000
    """The largest upload."""


class Page:
    """What one visitor sees, from opening the page until closing it."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._key = secrets.token_urlsafe(16)
        self._folder = Path(tempfile.mkdtemp(dir=settings.folder))
        self._bench: Workbench | None = None
        self._recording: Recording | None = None
        PAGES[self._key] = self
        ui.context.client.on_delete(self.close)
        dress()
        with ui.element("header"):
            ui.html("<h1>entrack</h1>", sanitize=False)
            self._name = ui.label().classes("name").mark("name")
            self._other = ui.button("Another video", icon="close", on_click=self._begin)
            self._other.props("flat no-caps dense").mark("other")
        self._main = ui.element("main")
        self._ask()

    async def _begin(self) -> None:
        """Let go of the video and ask for another one."""
        await self._end()
        self._ask()

    def _ask(self) -> None:
        self._name.set_text("")
        self._other.set_visibility(False)
        self._main.clear()
        with self._main:
            Start(self._folder, self._settings.megabytes, f"/camera/{self._key}", self._open)

    async def _open(self, path: Path, name: str) -> None:
        self._work(await asyncio.to_thread(lambda: self._session(Clip(path, name))))

    def _session(self, footage: Footage) -> Session:
        tracker = entrack.load(self._settings.model, threads=self._settings.threads)
        return Session(footage, tracker)

    def _work(self, session: Session) -> None:
        self._name.set_text(session.footage.name)
        self._other.set_visibility(True)
        self._main.clear()
        with self._main:
            self._bench = Workbench(session, self._folder, lambda: self._live)

    @property
    def _live(self) -> bool:
        return self._recording is not None and not self._recording.full

    async def take(self, jpeg: bytes) -> bool:
        """Take a frame of the camera, or leave it where nobody waits for it; False: no more.

        Until there is an object the newest frame is shown; while tracking each one that the tracker
        comes to is kept, so that it can be gone back to.
        """
        if self._recording is None:
            if self._bench:  # a video was chosen meanwhile
                return False
            largest = 1e6 * self._settings.megabytes
            self._recording = Recording(self._folder, jpeg, largest)
            self._work(await asyncio.to_thread(self._session, self._recording))
        elif self._bench and self._bench.waits_for_first:
            self._recording.restart(jpeg)
            await self._bench.go(0)
        elif self._bench and self._bench.waits_for_next:
            self._recording.add(jpeg)
        return self._live

    async def _end(self) -> None:
        bench, self._bench, self._recording = self._bench, None, None
        if bench:
            await bench.close()
        for path in self._folder.glob("*"):
            path.unlink(missing_ok=True)

    async def close(self) -> None:
        """Stop all work and delete all files of the page."""
        PAGES.pop(self._key, None)
        await self._end()
        shutil.rmtree(self._folder, ignore_errors=True)


def dress() -> None:
    """Give the page its looks."""
    ui.add_css(_STYLE)
    ui.colors(primary="#00796b", negative="#b3261e")


@app.post("/camera/{key}")
async def camera(key: str, request: Request) -> Response:
    """A frame of a page's camera, JPEG; the answer 410 says that no more are wanted."""
    page = PAGES.get(key)
    if page is None:
        return Response(status_code=410)
    if int(request.headers["content-length"]) > _PICTURE:
        return Response(status_code=413)
    try:
        return Response(status_code=204 if await page.take(await request.body()) else 410)
    except EntrackError as error:
        return Response(str(error), 400)
