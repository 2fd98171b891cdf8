"""Serve pages: on this machine only unless told otherwise, with limits on what comes in."""

import socket
import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

from nicegui import app, core, ui
from starlette.middleware.trustedhost import TrustedHostMiddleware

from entrack.errors import EntrackError
from entrack.web.guard import Guard

LOOPBACK = ("127.0.0.1", "localhost")
_REMEMBERED = 60  # messages, to be sent again after an interruption; they hold pictures
_SPARE = 1_000_000  # bytes that an upload's form may have around the file
_SILENCE = 60.0  # seconds that a browser may say nothing, on a machine that has no time for it
_MESSAGE = 1_000_000  # bytes of a websocket's message; the page's are of a few hundred


def serve(
    page: Callable[[], Any],
    host: str = "127.0.0.1",
    port: int = 8000,
    show: bool = True,
    megabytes: int = 1000,
    ready: Callable[[str], object] = print,
) -> None:
    """Serve pages until Ctrl-C or `nicegui.app.shutdown`.

    Parameters
    ----------
    page
        Builds one page, for each visitor.
    host, port
        Where to listen; port 0 takes a free one.
    show
        Open the page in this machine's browser, if it has one.
    megabytes
        Larger requests are refused.
    ready
        Called with the address before the server starts.

    Raises
    ------
    EntrackError
        If the port is taken or the host is none of this machine's.
    """
    port = _free(host, port)
    if host in LOOPBACK:  # else another site's name, made to point here, would be let in
        app.add_middleware(TrustedHostMiddleware, allowed_hosts=[*LOOPBACK])
    app.add_middleware(Guard, largest=megabytes * 1_000_000 + _SPARE)
    ready(f"http://{f'[{host}]' if ':' in host else host}:{port}")
    ui.page("/")(page)
    app.on_startup(_bear_silence)
    ui.run(
        host=host,
        port=port,
        show=show,
        title="entrack",
        favicon="🎯",
        dark=None,
        reload=False,
        tailwind=False,
        show_welcome_message=False,
        uvicorn_logging_level="error",
        ws_per_message_deflate=False,  # most of what is sent are JPEGs; and nothing is inflated
        ws_max_size=_MESSAGE,
        ws_ping_timeout=_SILENCE,
        message_history_length=_REMEMBERED,
        timeout_graceful_shutdown=1,
    )


def _bear_silence() -> None:
    """NiceGUI gives up a page that is silent for 2 s; one that is closed says so."""
    core.sio.eio.ping_timeout = _SILENCE  # pyright: ignore[reportUnknownMemberType]


@contextmanager
def scratch() -> Generator[str, None, None]:
    """A folder for everything that is written while serving, uploads on their way in included."""
    before = tempfile.tempdir
    with tempfile.TemporaryDirectory(prefix="entrack-") as folder:
        tempfile.tempdir = folder
        try:
            yield folder
        finally:
            tempfile.tempdir = before


def _free(host: str, port: int) -> int:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except (OSError, OverflowError) as error:
            raise EntrackError(f"cannot listen on {host}:{port}: {error}") from error
        return probe.getsockname()[1]
