"""The page once there is a video: watch, pause, step, go back, correct, take the result home."""

import asyncio
import time
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

from nicegui import ui
from nicegui.events import GenericEventArguments, KeyEventArguments

from entrack.box import Boxes
from entrack.errors import EntrackError
from entrack.web import views
from entrack.web.panel import Panel
from entrack.web.session import Session
from entrack.web.stage import Stage

P = ParamSpec("P")
T = TypeVar("T")
_SHOWN = 1 / 30  # seconds between two pictures shown; the tracker is not held up by more
_UNLOADED = 0.5  # seconds after which a picture that the browser did not get is given up
_PANEL = 0.25  # seconds between two updates of numbers and curves
_SHARE = """(e) => {
    const r = e.currentTarget.getBoundingClientRect();
    emit((e.clientX - r.left) / r.width);
}"""


class Workbench:
    """Everything that is done with one video on one page.

    The session is used in threads, one call at a time, so that the page answers meanwhile.

    Parameters
    ----------
    session
        Closed with the workbench.
    frames
        Address under which the page serves `jpeg`.
    folder
        For files that are made to be downloaded.
    live
        Whether frames still arrive: at the end playing waits for the next one.
    """

    def __init__(
        self, session: Session, frames: str, folder: Path, live: Callable[[], bool]
    ) -> None:
        self.session, self._frames, self._folder, self._live = session, frames, folder, live
        self.jpeg = views.jpeg(session.frame.image)
        self.playing = self.closed = False
        self.progress: float | None = None
        """Share of the annotated video that is made; None while none is."""
        self._lock = asyncio.Lock()
        self._wanted = 0
        self._count = 0
        self._sent = self._panel_due = 0.0
        self._loaded = True
        self._rate = 0.0
        self._build()
        self.refresh()

    def _build(self) -> None:
        with ui.element("div").classes("workbench"):
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
            self.panel = Panel(self.session, self.select, self.remove, self.download)
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
            await self._work(self._forward)
            self.refresh()

    async def go(self, index: int) -> None:
        """Look at another frame; of several that are asked for quickly, the last one."""
        self.pause()
        self._wanted = index
        async with self._lock:
            if index != self._wanted or self.closed:
                return
            await asyncio.to_thread(self._look_at, index)
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

    # What happens in threads.

    async def _work(self, call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        async with self._lock:
            return await asyncio.to_thread(call, *args, **kwargs)

    def _forward(self) -> bool:
        moved = not self.closed and self.session.forward()
        if moved and (self._may_show() or not self.playing):
            self.jpeg = views.jpeg(self.session.frame.image)
        return moved

    def _look_at(self, index: int) -> None:
        self.session.go(index)
        self.jpeg = views.jpeg(self.session.frame.image)

    def _render(self, path: Path) -> None:
        for share in self.session.write_video(path):
            self.progress = share
            if self.closed:
                return

    async def _play(self) -> None:
        self.playing, due, shown = True, time.perf_counter(), -1
        self._rate = 0.0
        self._buttons()
        try:
            await self._work(self.session.resume)
            while self.playing:
                show = self._may_show()
                if not await self._work(self._forward):
                    if not self._live():
                        break
                    await asyncio.sleep(0.01)
                    continue
                if show and self.playing:
                    shown = self._show()
                if not self.session.fresh:  # seen before: at the video's own pace
                    due = max(due + 1 / self.session.footage.fps, time.perf_counter())
                    await asyncio.sleep(due - time.perf_counter())
        except EntrackError as error:
            ui.notify(str(error), type="negative", timeout=0, close_button=True)
        finally:
            self.playing = False
            if not self.closed:
                if shown != self.session.frame.index:
                    await self._work(self._look_at, self.session.frame.index)
                self.refresh()

    # What is shown.

    def _may_show(self) -> bool:
        waited = time.perf_counter() - self._sent
        return waited >= _UNLOADED or (self._loaded and waited >= _SHOWN)

    def _on_loaded(self) -> None:
        self._loaded = True

    def _show(self) -> int:
        """Show picture and boxes of the frame, and its numbers if they are due."""
        now = time.perf_counter()
        rate = 1 / max(now - self._sent, 1e-3)
        self._rate = 0.9 * (self._rate or rate) + 0.1 * rate
        self._sent, self._loaded = now, False
        self._count += 1
        session, index = self.session, self.session.frame.index
        self.stage.show(f"{self._frames}/{self._count}", session.footage.size)
        self.stage.mark(session.estimates)
        end = max(len(session.footage) - 1, 1)
        if now >= self._panel_due or not self.playing:
            self._panel_due = now + _PANEL
            self._slider.props(f"max={end}")
            self._slider.set_value(index)
            self._head.style(f"left: {100 * index / end:.2f}%")
            self._place.set_text(f"frame {index} of {end} · {session.frame.time:.2f} s")
            tracks = [target.estimates for target in session.targets]
            self._chart.set_content(views.chart(tracks, len(session.footage)))
            self.panel.update(self.stage.number, self._rate if self.playing else None)
            self._say()
        return index

    def refresh(self) -> None:
        """Show everything as it is now."""
        if not self.closed:
            self._show()
            self._buttons()
            self._say()

    def _buttons(self) -> None:
        self._track.set_text("Pause" if self.playing else "Track")
        self._track.set_icon("pause" if self.playing else "play_arrow")
        more = self._live() or self.session.frame.index + 1 < len(self.session.footage)
        self._track.set_enabled(more and bool(self.session.targets))
        self._back.set_enabled(self.session.frame.index > 0)
        self._next.set_enabled(more)

    def _say(self) -> None:
        """One sentence under the picture: what is the matter, or what to do next."""
        estimates, number = self.session.estimates, self.stage.number
        lost = [str(i + 1) for i, e in enumerate(estimates) if e is not None and e.lost]
        if lost:
            text = f"Object {' and '.join(lost)} lost. Drag its box again where you see it."
        elif number >= len(estimates):
            text = f"Drag a box around {'another' if number else 'an'} object."
        elif self.session.frame.index + 1 >= len(self.session.footage) and not self._live():
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
