"""The page once there is a video: watch, pause, step, go back, correct, take the result home."""

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import ParamSpec, TypeVar

from nicegui import ui
from nicegui.events import GenericEventArguments, KeyEventArguments

from entrack.box import Boxes
from entrack.errors import EntrackError
from entrack.web.panel import Panel
from entrack.web.session import Session
from entrack.web.shot import Shot, take
from entrack.web.stage import Stage

P = ParamSpec("P")
T = TypeVar("T")
_SHOWN = 1 / 30  # seconds between two pictures shown; the tracker is not held up by more
_AHEAD = 2  # pictures on their way to the browser at a time: the next one while one is drawn
_UNLOADED = 0.5  # seconds after which pictures that the browser did not get are given up
_PANEL = 0.25  # seconds between two updates of numbers and curves
_SHARE = """(e) => {
    const r = e.currentTarget.getBoundingClientRect();
    emit((e.clientX - r.left) / r.width);
}"""

# Keys do not step while a button has the focus, as a click of the mouse would leave it there.
_UNFOCUS = "(e) => { if (e.detail) document.activeElement.blur(); }"


class Workbench:
    """Everything that is done with one video on one page.

    The session is used in one thread, which tracks without waiting for the page and hands over
    `Shot`s of what it sees; the page answers meanwhile.

    Parameters
    ----------
    session
        Closed with the workbench.
    folder
        For files that are made to be downloaded.
    live
        Whether frames still arrive: at the end playing waits for the next one.
    """

    def __init__(self, session: Session, folder: Path, live: Callable[[], bool]) -> None:
        self.session, self._folder, self._live = session, folder, live
        self.playing = self.closed = False
        self.progress: float | None = None
        """Share of the annotated video that is made; None while none is."""
        self._lock = asyncio.Lock()
        self._thread = ThreadPoolExecutor(1, "entrack-page")
        self._wanted = 0
        self._sent = self._due = self._panel_due = 0.0
        self._under_way = 0
        self._rate = 0.0
        self._build()
        self.refresh()

    def _build(self) -> None:
        with ui.element("div").classes("workbench") as bench:
            bench.on("click", js_handler=_UNFOCUS)
            with ui.element("div").classes("watch"):
                self.stage = Stage(self.pause, self.put)
                self.stage.image.on("loaded", self._on_loaded, args=[])
                self.message = ui.label().classes("message").mark("message")
                with ui.element("div").classes("controls"):
                    self._back = _icon("skip_previous", "Step back (←)", lambda: self.step(-1))
                    self._track = ui.button(icon="play_arrow", on_click=self.toggle, color=None)
                    self._track.classes("track").mark("track").props("unelevated no-caps")
                    self._next = _icon("skip_next", "Step forward (→)", lambda: self.step(1))
                    self._place = ui.label().classes("place").mark("place")
                self._slider = ui.slider(min=0, max=1, value=0).props('aria-label="Frame"')
                self._slider.on("update:model-value", self._slide, throttle=0.05)
                with ui.element("div").classes("chart") as chart:
                    self._chart = ui.html(sanitize=False)
                    self._head = ui.element("div").classes("head")
                    ui.label("score").classes("axis")
                chart.on("click", self._click_chart, js_handler=_SHARE)
            self.panel = Panel(self.select, self.remove, self.download)
            self.panel.progress.bind_visibility_from(self, "progress", lambda p: p is not None)
            self.panel.progress.bind_value_from(self, "progress", lambda p: round(p or 0, 2))
        ui.keyboard(self._key)

    # What the user does.

    def select(self, number: int) -> None:
        """Make the next drag one for this object; the number after the last adds one."""
        self.stage.number = number
        self.refresh()

    async def put(self, box: Boxes) -> None:
        """Take a box that was drawn in this frame."""
        try:
            await self._work(self.session.put, self.stage.number, box)
        except EntrackError as error:
            ui.notify(str(error), type="negative")
        self.refresh()

    async def remove(self, number: int) -> None:
        """Forget an object."""
        self.pause()
        await self._work(self.session.remove, number)
        self.stage.number = min(self.stage.number, max(len(self.session.targets) - 1, 0))
        self.refresh()

    async def toggle(self) -> None:
        """Play or pause."""
        if self.playing:
            return self.pause()
        if self.session.targets:
            await self._play()
        return None

    def pause(self) -> None:
        """Stop after the frame that is being looked at."""
        self.playing = False

    async def step(self, by: int) -> None:
        """Go one frame back, or one on, tracking it."""
        self.pause()
        if by < 0:
            await self.go(self.session.frame.index + by)
        else:
            await self._work(self.session.forward)
            self.refresh()

    async def go(self, index: int) -> None:
        """Look at another frame; of several that are asked for quickly, the last one."""
        self.pause()
        self._wanted = index
        async with self._lock:
            if index != self._wanted or self.closed:
                return
            await self._call(self.session.go, index)
        self.refresh()

    async def download(self, kind: str) -> None:
        """Make a file of what is known, and hand it to the browser."""
        self.pause()
        path = self._folder / f"tracked.{kind}"
        try:
            if kind == "mp4":
                await self._work(self._render, path)
            else:
                await self._work(self.session.write_boxes, path)
        except EntrackError as error:
            ui.notify(str(error), type="negative")
            return
        finally:
            self.progress = None
        if not self.closed:
            ui.download.file(path, f"{Path(self.session.footage.name).stem}-tracked.{kind}")

    @property
    def waits_for_first(self) -> bool:
        """Whether nothing is done yet with the frame that is shown."""
        return not (self.session.targets or self.stage.drawing or self._lock.locked())

    @property
    def waits_for_next(self) -> bool:
        """Whether the last frame is tracked, and the next one can be."""
        return self.playing and self.session.frame.index + 1 == len(self.session.footage)

    async def close(self) -> None:
        """Stop all work and let go of the video."""
        self.playing, self.closed = False, True
        async with self._lock:
            self.session.close()
        self._thread.shutdown(wait=False)

    # What happens in the session's thread.

    async def _work(self, call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        async with self._lock:
            return await self._call(call, *args, **kwargs)

    async def _call(self, call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        if self.closed:  # while it waited for its turn: nobody is there to see what it does
            raise asyncio.CancelledError
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._thread, partial(call, *args, **kwargs))

    def _render(self, path: Path) -> None:
        for share in self.session.write_video(path):
            self.progress = share
            if self.closed:
                return

    async def _play(self) -> None:
        self.playing = True
        self._buttons()
        try:
            await self._work(self._run, asyncio.get_running_loop())
        except EntrackError as error:
            ui.notify(str(error), type="negative", timeout=0, close_button=True)
        finally:
            self.playing = False
            self.refresh()

    def _run(self, loop: asyncio.AbstractEventLoop) -> None:
        """Track, or play what is known, until the end or a pause."""
        self.session.resume()
        self._rate, self._under_way, due = 0.0, 0, time.perf_counter()
        while self.playing:
            if not self.session.forward():
                if not self._live():
                    return
                time.sleep(0.01)
                continue
            if self._may_show():
                loop.call_soon_threadsafe(self._show, self._next_shot())
            if not self.session.fresh:  # seen before: at the video's own pace
                due = max(due + 1 / self.session.footage.fps, time.perf_counter())
                time.sleep(due - time.perf_counter())

    def _may_show(self) -> bool:
        now = time.perf_counter()
        return now >= self._sent + _UNLOADED or (self._under_way < _AHEAD and now >= self._due)

    def _next_shot(self) -> Shot:
        """What to show now; the numbers beside the picture are only in it where they are due."""
        now = time.perf_counter()
        rate, waited = 1 / (now - self._sent), now - self._sent
        if waited >= _UNLOADED:
            self._under_way = 0
        else:
            self._rate = 0.9 * (self._rate or rate) + 0.1 * rate
        self._sent, self._under_way = now, self._under_way + 1
        self._due = max(self._due + _SHOWN, now)  # a picture that came late lets the next be early
        full = now >= self._panel_due
        self._panel_due = now + _PANEL if full else self._panel_due
        return take(self.session, self.stage.number, full)

    # What is shown.

    def _on_loaded(self) -> None:
        self._under_way = max(self._under_way - 1, 0)

    def _show(self, shot: Shot) -> None:
        """Show a picture with its boxes, and the numbers beside it if it has them."""
        if self.closed:
            return
        self.stage.show(shot.picture, self.session.footage.size)
        self.stage.mark(shot.estimates)
        if shot.details:
            end = max(shot.length - 1, 1)
            self._slider.props(f"max={end}")
            self._slider.set_value(shot.index)
            self._head.style(f"left: {100 * shot.index / end:.2f}%")
            self._place.set_text(f"frame {shot.index} of {end} · {shot.time:.2f} s")
            self._chart.set_content(shot.details.chart)
            self.panel.update(shot, self.stage.number, self._rate if self.playing else None)
            self._say(shot)

    def refresh(self) -> None:
        """Show everything as it is now."""
        if self.closed:
            return
        self._buttons()
        self._panel_due = 0.0
        if not self._lock.locked():  # else whoever uses the session shows it in the end
            self._show(take(self.session, self.stage.number))

    def _buttons(self) -> None:
        self._track.set_text("Pause" if self.playing else "Track")
        self._track.set_icon("pause" if self.playing else "play_arrow")
        more = self._live() or self.session.frame.index + 1 < len(self.session.footage)
        self._track.set_enabled(more and bool(self.session.targets))
        self._back.set_enabled(self.session.frame.index > 0)
        self._next.set_enabled(more)

    def _say(self, shot: Shot) -> None:
        """One sentence under the picture: what is the matter, or what to do next."""
        estimates, number = shot.estimates, self.stage.number
        lost = [str(i + 1) for i, e in enumerate(estimates) if e is not None and e.lost]
        if lost:
            text = f"Object {' and '.join(lost)} lost. Drag its box again where you see it."
        elif number >= len(estimates):
            text = f"Drag a box around {'another' if number else 'an'} object."
        elif shot.index + 1 >= shot.length and not self._live():
            text = "The last frame: download the result, or go back and correct it."
        elif self.playing:
            text = "Drag at any time to correct the box."
        else:
            text = f"Press Track, or drag again to correct the box of object {number + 1}."
        self.message.set_text(text)
        self.message.classes(add="lost") if lost else self.message.classes(remove="lost")

    # What the widgets say.

    async def _slide(self, event: GenericEventArguments) -> None:
        await self.go(int(event.args))

    async def _click_chart(self, event: GenericEventArguments) -> None:
        await self.go(round(event.args * (len(self.session.footage) - 1)))

    async def _key(self, event: KeyEventArguments) -> None:
        if not event.action.keydown:
            return
        if event.key == " " and not event.action.repeat:
            await self.toggle()
        elif event.key.arrow_left or event.key.arrow_right:
            await self.step(-1 if event.key.arrow_left else 1)


def _icon(icon: str, label: str, on_click: Callable[[], object]) -> ui.button:
    button = ui.button(icon=icon, on_click=on_click).props(f'flat round aria-label="{label}"')
    return button.tooltip(label)
