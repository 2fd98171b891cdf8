"""A visitor who does not mean well, on a page that is served: SECURITY.md has the list."""

import asyncio
import contextlib
import html
import http.client
import json
import time
from collections.abc import Awaitable, Callable, Generator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

pytest.importorskip("nicegui", reason="needs the extra web")
pytest.importorskip("socketio")
pytest.importorskip("aiohttp")

import aiohttp
from reliability.soak import resident
from reliability.soak_web import answering, clip, served, soak
from reliability.visitor import Visitor, labelled, of_class


class Server:
    """A page that is served, and where it keeps its files."""

    def __init__(self, address: str, pid: int, folder: Path) -> None:
        self.address, self.pid, self.folder = address, pid, folder

    def visit(self, act: Callable[[Visitor], Awaitable[None]]) -> None:
        """Open the page and do something there."""

        async def go() -> None:
            await answering(self.address)
            async with Visitor(self.address) as visitor:
                await act(visitor)

        asyncio.run(go())

    @property
    def files(self) -> set[Path]:
        """Of all pages; those of a page that was closed stay for some seconds."""
        return {p for p in self.folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Generator[Server, None, None]:
    folder = tmp_path_factory.mktemp("served")
    with served("--threads", "1", "--megabytes", "1", TMPDIR=str(folder)) as (address, pid):
        yield Server(address, pid, folder)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("video") / "clip.mp4"
    clip(path, 1, 5)
    return path.read_bytes()


def test_a_name_leads_nowhere_else_and_is_no_markup(server: Server, video: bytes) -> None:
    name = "../../<img src=x onerror=alert(1)>.mp4"

    async def act(visitor: Visitor) -> None:
        before = server.files
        assert await visitor.upload(name, video) == 200
        await visitor.until(lambda: visitor.sees(of_class("stage")))
        assert "_img src=x onerror=alert(1)_.mp4" in visitor.texts
        assert [path.name for path in server.files - before] == ["video.mp4"]
        for element in visitor.elements.values():
            markup = json.dumps(element.get("props", {})) + json.dumps(element.get("slots", {}))
            assert "onerror" not in markup  # it is text, which no browser takes for anything else

    server.visit(act)


def test_what_is_complained_of_is_no_markup(server: Server) -> None:
    async def act(visitor: Visitor) -> None:
        before = server.files
        await visitor.upload("<script>alert(1)</script>", b"nothing")
        await visitor.until(lambda: any("is no video" in text for text in visitor.texts))
        everything = json.dumps(visitor.elements) + "".join(visitor.notes)
        assert "<script" not in html.unescape(everything)
        assert not server.files - before

    server.visit(act)


BOMBS = {
    "wide.gif": b"GIF89a\xff\xff\xff\xff\x80\0\0\0\0\0\xff\xff\xff,\0\0\0\0\xff\xff\xff\xff\0"
    b"\x02\x02D\x01\0;",
    "list.mp4": b"#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n#EXT-X-ENDLIST\n",
    "zeros.mkv": bytes(900_000),
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_small_file_does_not_become_a_large_one(server: Server, name: str) -> None:
    before, memory = server.files, resident(server.pid)

    async def act(visitor: Visitor) -> None:
        await visitor.upload(name, BOMBS[name])
        await visitor.until(lambda: any("not a video that can be read" in t for t in visitor.texts))

    server.visit(act)
    assert resident(server.pid) - memory < 100 and not server.files - before


def test_a_camera_that_sends_a_bomb_is_refused(server: Server) -> None:
    """A JPEG of 65,500 × 65,500 pixels in a few bytes."""
    size = (65_500).to_bytes(2, "big")
    jpeg = (
        b"\xff\xd8\xff\xc0\0\x11\x08" + size + size + b"\x03\x01\x11\0\x02\x11\0\x03\x11\0\xff\xd9"
    )

    async def act(visitor: Visitor) -> None:
        _, button = visitor.find(labelled("Use the camera"))
        handlers = " ".join(str(e["js_handler"]) for e in button["events"])
        path = handlers.split("/camera/")[1].split("'")[0]
        place = urlsplit(server.address)
        connection = http.client.HTTPConnection(str(place.hostname), place.port, timeout=60)
        connection.request("POST", f"/camera/{path}", jpeg)
        assert connection.getresponse().status == 400

    server.visit(act)


def test_a_page_of_another_site_gets_no_answer_and_no_socket(server: Server) -> None:
    async def act(visitor: Visitor) -> None:
        headers = {"Origin": "http://evil.example"}
        async with aiohttp.ClientSession(headers=headers) as session:
            for address in (server.address, visitor.upload_address):
                async with session.post(address, data=b"x") as answer:
                    assert answer.status == 403
            for transport in ("polling", "websocket"):
                place = f"/_nicegui_ws/socket.io/?EIO=4&transport={transport}"
                with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                    await session.ws_connect(server.address + place)

    server.visit(act)


def test_a_flood_of_messages_holds_nobody_up(server: Server, video: bytes) -> None:
    """What is sent: events of no element and of no form at all, and answers to nothing."""
    before = resident(server.pid)

    async def flood(visitor: Visitor) -> None:
        """Write to the socket as fast as it takes it, without NiceGUI's or socket.io's client."""
        key, _ = visitor.find(labelled("Try the example"))
        about = {"client_id": visitor.client}
        messages = [
            ["event", about | {"id": int(key), "listener_id": "x", "args": ["{}"]}],
            ["event", about | {"id": -1, "args": "no"}],
            ["event", "x" * 1000],
            ["javascript_response", about],
            ["ack", about | {"next_message_id": None}],
        ]
        place = f"{server.address}/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
        async with aiohttp.ClientSession() as session, session.ws_connect(place) as socket:
            await socket.receive()
            await socket.send_str("40")
            with contextlib.suppress(ConnectionError):  # it may be thrown out
                for _ in range(20_000):
                    for message in messages:
                        await socket.send_str("42" + json.dumps(message))
                    await asyncio.sleep(0)

    async def act(honest: Visitor) -> None:
        async with Visitor(server.address) as other:
            work = asyncio.create_task(flood(other))
            assert await honest.upload("honest.mp4", video) == 200
            await honest.until(lambda: honest.sees(of_class("stage")), 30)
            await asyncio.sleep(2)
            async with Visitor(server.address) as third:
                assert third.sees(of_class("drop"))
            work.cancel()
            await asyncio.gather(work, return_exceptions=True)

    server.visit(act)
    assert resident(server.pid) - before < 150


def test_a_visitor_who_is_silent_for_a_while_keeps_the_page(server: Server, video: bytes) -> None:
    """As a browser on a machine that is busy: no answer to what the server asks, for 8 s."""

    async def act(visitor: Visitor) -> None:
        assert await visitor.upload("clip.mp4", video) == 200
        await visitor.until(lambda: visitor.sees(of_class("stage")))
        time.sleep(8)  # nothing of this program runs
        await visitor.drag((0.2, 0.3, 0.5, 0.6))
        await visitor.until(lambda: any("Press Track" in text for text in visitor.texts))

    server.visit(act)


def test_several_visitors_at_once_get_what_is_theirs(tmp_path: Path) -> None:
    figures, wrong = asyncio.run(soak(3, 0, 12, tmp_path))
    assert not wrong
    assert figures["rounds"] == 3 and figures["pictures"] >= 3
