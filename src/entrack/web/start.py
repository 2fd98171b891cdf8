"""The page before there is a video: upload one, take the example, or the camera."""

import asyncio
import re
from collections.abc import Awaitable, Callable
from pathlib import Path

from nicegui import ui
from nicegui.events import GenericEventArguments, UploadEventArguments

from entrack.errors import EntrackError
from entrack.model import assets
from entrack.video import VideoWriter
from entrack.web.camera import SCRIPT

SUFFIXES = ".mp4 .m4v .mov .mkv .webm .avi .mpg .mpeg .ts .mts .3gp .wmv .flv .ogv .gif".split()
_EXAMPLE = assets() / "demo" / "clip.mp4"


class Start:
    """Ask for a video.

    Parameters
    ----------
    folder
        For the upload.
    megabytes
        The largest upload.
    camera
        Address that the camera's frames are posted to.
    open_
        Called with a video's path and name; what it raises is shown.
    """

    def __init__(
        self,
        folder: Path,
        megabytes: int,
        camera: str,
        open_: Callable[[Path, str], Awaitable[None]],
    ) -> None:
        self._folder, self._open = folder, open_
        with ui.element("div").classes("start"):
            ui.html("<h2>Track anything in a video</h2>", sanitize=False)
            ui.label("Choose a video, drag a box around something in it, press Track.")
            self._drop_zone(megabytes)
            self._error = ui.label().classes("error").props('role="alert"').mark("error")
            self._busy = ui.linear_progress(show_value=False).props("indeterminate rounded")
            self._busy.set_visibility(False)
            with ui.element("div").classes("others"):
                example = ui.button("Try the example", icon="play_circle").mark("example")
                example.on_click(lambda: self._take(_EXAMPLE, "example.mp4"))
                harder = ui.button("Try a harder one", icon="visibility_off").mark("harder")
                harder.on_click(self._harder)
                lens = ui.button("Use the camera", icon="videocam").mark("camera")
                for button in (example, harder, lens):
                    button.props("flat no-caps")
                start = f"({SCRIPT})('{camera}').catch((e) => emit(e.message))"
                lens.on("click", self._no_camera, js_handler=f"() => {start}")
            ui.label("Videos stay on the computer that serves this page.")
            ui.label("Closing the page deletes them.")

    def _drop_zone(self, megabytes: int) -> None:
        upload = ui.upload(
            on_begin_upload=lambda: self._busy.set_visibility(True),
            on_upload=self._upload,
            on_rejected=lambda: self._complain(
                f"That is no video file, or one of more than {megabytes} MB."
            ),
            auto_upload=True,
            max_file_size=megabytes * 1_000_000,
        )
        upload.props(f'accept="video/*,{",".join(SUFFIXES)}"').classes("hidden")
        picker = f"getElement({upload.id}).$refs.qRef"
        with ui.element("button").classes("drop").mark("drop") as zone:
            ui.icon("upload_file", size="40px")
            ui.label("Choose a video, or drop one here").classes("big")
            ui.label(f"MP4, MOV, MKV, WebM, AVI, … up to {megabytes} MB")
        zone.on("click", js_handler=f"() => {picker}.pickFiles()")
        zone.on("dragover", js_handler="(e) => e.preventDefault()")
        add = f"{picker}.addFiles(e.dataTransfer.files)"
        zone.on("drop", js_handler=f"(e) => {{ e.preventDefault(); {add}; }}")

    async def _upload(self, event: UploadEventArguments) -> None:
        name = safe_name(event.file.name)
        suffix = Path(name).suffix.lower()
        if suffix not in SUFFIXES:
            self._complain(f"{name} is no video: its name ends in none of {' '.join(SUFFIXES)}.")
            return
        path = self._folder / f"video{suffix}"
        await event.file.save(path)
        await self._take(path, name)

    async def _take(self, path: Path, name: str) -> None:
        self._error.set_text("")
        self._busy.set_visibility(True)
        try:
            await self._open(path, name)
        except EntrackError as error:
            self._complain(f"{error}.")
            if path != _EXAMPLE:
                path.unlink(missing_ok=True)

    async def _harder(self) -> None:
        self._busy.set_visibility(True)
        path = await asyncio.to_thread(hide_and_seek, self._folder / "harder.mp4")
        await self._take(path, path.name)

    def _no_camera(self, event: GenericEventArguments) -> None:
        self._complain(f"The camera cannot be used: {event.args}.")

    def _complain(self, why: str) -> None:
        self._error.set_text(why)
        self._busy.set_visibility(False)


def hide_and_seek(path: Path) -> Path:
    """Write a made video whose blue thing is hidden for a while, and later leaves the picture."""
    from entrack.datasets import open_dataset

    sequence = open_dataset("synthetic:hard,count=4")[3]
    with VideoWriter(path, 30) as video:
        for index in range(len(sequence)):
            video.write(sequence.frames[index], index / 30)
    return path


def safe_name(name: str) -> str:
    r"""A file name as it may be shown and given to a download: no path, no control characters.

    >>> safe_name("../../etc/pass wd\n.mp4")
    'pass wd_.mp4'
    >>> safe_name("C:\\clips\\surfer.mp4")
    'surfer.mp4'
    """
    last = re.split(r"[/\\]", name)[-1].strip(". ")
    return re.sub(r'[\x00-\x1f\x7f<>:"|?*]', "_", last)[-100:] or "video"
