"""The picture on which boxes are drawn, with mouse, pen or finger."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from nicegui import ui
from nicegui.events import GenericEventArguments

from entrack.box import Boxes, from_corners
from entrack.tracker import Estimate
from entrack.web import views

# The pointer is captured, so that a drag may leave the picture; shares of the picture are sent.
_POINTER = """(e) => {
    const stage = e.currentTarget, r = stage.getBoundingClientRect();
    if (e.type === 'pointerdown' && e.isPrimary && !e.button) stage.setPointerCapture(e.pointerId);
    if (!stage.hasPointerCapture(e.pointerId)) return;
    emit(e.type, (e.clientX - r.left) / r.width, (e.clientY - r.top) / r.height);
}"""
_SMALLEST = 4.0  # pixels; less is a click, not a box


class Stage:
    """A picture with boxes over it; a drag on it calls `on_box` with the box in pixels.

    Parameters
    ----------
    on_start
        Called when a drag begins.
    on_box
        Called with `(x, y, w, h)` when it ends, clipped to the picture.
    """

    def __init__(self, on_start: Callable[[], Any], on_box: Callable[[Boxes], Any]) -> None:
        self._on_start, self._on_box = on_start, on_box
        self._from: tuple[float, float] | None = None
        self._size = (1, 1)
        self.number = 0
        """The object that a drag is for."""
        with ui.element("div").classes("stage").mark("stage") as self.root:
            self.image = ui.interactive_image()
            self._boxes = ui.html(sanitize=False).classes("boxes")
            self._drawn = ui.html(sanitize=False).classes("boxes")
        for event in ("pointerdown", "pointerup", "pointercancel"):
            self.root.on(event, self._point, js_handler=_POINTER)
        self.root.on("pointermove", self._point, js_handler=_POINTER, throttle=0.03)

    @property
    def drawing(self) -> bool:
        """Whether a drag is under way."""
        return self._from is not None

    def show(self, source: str, size: tuple[int, int]) -> None:
        """Show a picture of `size` (width, height) from an address."""
        if size != self._size:
            self._size = size
            self.root.style(f"--ratio: {size[0] / size[1]:.5f}")
        self.image.set_source(source)

    def mark(self, estimates: Sequence[Estimate | None]) -> None:
        """Show the boxes of the picture's objects."""
        self._boxes.set_content(views.boxes(estimates, self._size))

    def _point(self, event: GenericEventArguments) -> Any:
        kind, *place = event.args
        x, y = np.clip(place, 0, 1) * self._size
        if kind == "pointerdown":
            self._from = (x, y)
            return self._on_start()
        if self._from is None:
            return None
        box = from_corners([*self._from, x, y])
        if kind == "pointermove":
            self._drawn.set_content(views.drawn(box, self._size, self.number))
            return None
        self._from = None
        self._drawn.set_content("")
        if kind == "pointerup" and box[2:].min() >= _SMALLEST:
            return self._on_box(box)
        return None
