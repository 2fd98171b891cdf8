"""Beside the picture: the objects, what the tracker sees of one of them, and the downloads."""

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from entrack.tracker import Estimate
from entrack.web import views
from entrack.web.shot import SIDE, Shot


class Panel:
    """The column beside the picture.

    Parameters
    ----------
    select, remove
        Called with an object's number, from 0; `select` with the next free one to add an object.
    download
        Called with "mp4", "csv" or "jsonl".
    """

    def __init__(
        self,
        select: Callable[[int], object],
        remove: Callable[[int], Awaitable[None]],
        download: Callable[[str], Awaitable[None]],
    ) -> None:
        self._select, self._remove = select, remove
        self._rows: list[_Row] = []
        with ui.element("div").classes("panel"):
            with ui.element("section"):
                ui.label("Objects").classes("title")
                self._none = ui.label("None yet: drag a box in the picture.").classes("hint")
                self._objects = ui.element("div").classes("objects")
                self._add = ui.button(
                    "Add an object", icon="add", on_click=lambda: select(len(self._rows))
                )
                self._add.props("flat no-caps dense").mark("add")
            with ui.element("section") as self._looks:
                ui.label("What the tracker sees").classes("title")
                with ui.element("div").classes("looks"):
                    self._search = _picture("search window")
                    self._response = _picture("response map")
                self._speed = ui.label().classes("speed").mark("speed")
            with ui.element("section"):
                ui.label("Download").classes("title")
                with ui.element("div").classes("downloads"):
                    self._buttons = [
                        ui.button(kind.upper(), on_click=_call(download, kind))
                        .props("outline no-caps dense")
                        .mark(kind)
                        for kind in ("mp4", "csv", "jsonl")
                    ]
                self.progress = ui.linear_progress(show_value=False).props("rounded")

    def update(self, shot: Shot, selected: int, shown: float | None) -> None:
        """Show the numbers of a frame; `shown` is the rate of pictures a second."""
        estimates = shot.estimates
        if len(self._rows) != len(estimates):
            self._objects.clear()
            with self._objects:
                self._rows = [
                    _Row(number, self._select, self._remove) for number in range(len(estimates))
                ]
        for number, (row, estimate) in enumerate(zip(self._rows, estimates, strict=True)):
            row.update(estimate, number == selected)
        self._none.set_visibility(not estimates)
        self._add.set_visibility(0 < len(estimates) and selected < len(estimates))
        for button in self._buttons:
            button.set_enabled(bool(estimates))
        if shot.details:
            self._search.set_source(shot.details.search)
            self._response.set_source(shot.details.response)
            self._looks.set_visibility(bool(shot.details.response))
        ms = sum(e.ms for e in estimates if e is not None)
        rate = f" · {shown:.0f} frames/s shown" if shown else ""
        self._speed.set_text(f"{ms:.0f} ms a frame to track{rate}")


class _Row:
    """One object of the list."""

    def __init__(
        self, number: int, select: Callable[[int], object], remove: Callable[[int], Any]
    ) -> None:
        with ui.element("div").classes("object").mark(f"object-{number + 1}") as self._root:
            self._root.style(f"--ink: {views.colour(number)}")
            self._root.props('role="button" tabindex="0"')
            self._root.on("click", lambda: select(number))
            self._root.on("keydown.enter", lambda: select(number))
            ui.label(f"{number + 1}").classes("number")
            self._words = ui.label().classes("words")
            with ui.element("div").classes("bar"):
                self._bar = ui.element("div")
            trash = ui.button(icon="close").props('flat round dense size="sm"')
            trash.props(f'aria-label="Remove object {number + 1}"')
            trash.on("click.stop", lambda: remove(number))

    def update(self, estimate: Estimate | None, selected: bool) -> None:
        self._words.set_text(views.words(estimate))
        self._bar.style(f"width: {estimate.score if estimate else 0:.0%}")
        lost = estimate is not None and estimate.lost
        for name, on in (("lost", lost), ("selected", selected)):
            self._root.classes(**{"add" if on else "remove": name})


def _picture(caption: str) -> ui.interactive_image:
    with ui.element("figure"):
        picture = ui.interactive_image(size=(SIDE, SIDE))
        ui.html(caption, tag="figcaption", sanitize=False)
    return picture


def _call(call: Callable[[str], Awaitable[None]], kind: str) -> Callable[[], Awaitable[None]]:
    return lambda: call(kind)
