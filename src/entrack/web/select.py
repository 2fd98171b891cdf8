"""`entrack track --select`: draw the boxes on a page, then go on in the terminal."""

import asyncio
from collections.abc import Callable

from nicegui import app, ui

from entrack.box import Boxes
from entrack.datasets.frames import Image
from entrack.errors import EntrackError
from entrack.tracker import Estimate
from entrack.web import views
from entrack.web.page import dress
from entrack.web.server import serve
from entrack.web.stage import Stage

# The server is about to go; without this the page would complain that it cannot reach it.
_FAREWELL = """
    window.socket.disconnect();
    document.getElementById('popup').style.display = 'none';
    document.querySelector('main').innerHTML = '<div class="start">'
        + '<h2>Tracking goes on in the terminal</h2>You can close this page.</div>';
"""


class Selection:
    """A page with one picture, on which boxes are drawn until the user is content."""

    def __init__(self, image: Image, name: str, done: Callable[[list[Boxes]], object]) -> None:
        self._size = (image.shape[1], image.shape[0])
        self._boxes: list[Boxes] = []
        self._done = done
        dress()
        with ui.element("header"):
            ui.html("<h1>entrack</h1>", sanitize=False)
            ui.label(name).classes("name")
        with ui.element("main"), ui.element("div").classes("watch"):
            self._stage = Stage(lambda: None, self._put)
            self._stage.show(views.data_url(image), self._size)
            self._message = ui.label().classes("message")
            with ui.element("div").classes("controls"):
                self._go = ui.button("Track", icon="play_arrow", on_click=self._finish, color=None)
                self._go.classes("track").props("unelevated no-caps")
                self._add = ui.button("Add an object", icon="add", on_click=self._next)
                self._clear = ui.button("Start over", icon="clear", on_click=self._start_over)
                for button in (self._add, self._clear):
                    button.props("flat no-caps")
        self._show()

    def _put(self, box: Boxes) -> None:
        self._boxes[self._stage.number :] = [box]
        self._show()

    def _next(self) -> None:
        self._stage.number = len(self._boxes)
        self._show()

    def _start_over(self) -> None:
        self._boxes, self._stage.number = [], 0
        self._show()

    def _show(self) -> None:
        number, known = self._stage.number, len(self._boxes)
        self._stage.mark(
            [Estimate(b, 1.0, False, None, None, search=b, ms=0.0) for b in self._boxes]
        )
        self._go.set_enabled(known > 0)
        self._add.set_enabled(number < known)
        self._clear.set_enabled(known > 0)
        self._message.set_text(
            "Press Track to go on in the terminal, or drag again to correct the box."
            if number < known
            else f"Drag a box around {'another' if known else 'the'} object."
        )

    async def _finish(self) -> None:
        self._done(self._boxes)
        ui.run_javascript(_FAREWELL)
        await asyncio.sleep(0.3)  # for the farewell to arrive
        app.shutdown()


def select(image: Image, name: str, ready: Callable[[str], object]) -> list[Boxes]:
    """Serve a page on which boxes are drawn on `image` (H, W, 3) BGR; return them.

    Parameters
    ----------
    ready
        Called with the page's address, which is also opened in this machine's browser.

    Raises
    ------
    EntrackError
        If the server ends without a box.
    """
    chosen: list[Boxes] = []
    serve(lambda: Selection(image, name, chosen.extend), port=0, ready=ready)
    if not chosen:
        raise EntrackError("no box was drawn")
    return chosen
