"""The guard before the page, without a server: who is let in, how slowly, how often."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("nicegui", reason="needs the extra web")

from entrack.web import guard

HOST = (b"host", b"127.0.0.1:8000")


def ask(
    kind: str, *headers: tuple[bytes, bytes], method: str = "GET", receive: Any = None
) -> list[dict[str, Any]]:
    """What the guard sends for a request; an app behind it reads the body and answers 200."""
    sent: list[dict[str, Any]] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        while (await receive()).get("more_body"):
            pass
        await send({"type": f"{kind}.response.start", "status": 200, "headers": []})

    async def nothing() -> dict[str, Any]:
        return {"type": f"{kind}.request"}

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    scope = {"type": kind, "method": method, "headers": [HOST, *headers]}
    asyncio.run(guard.Guard(app, 1000)(scope, receive or nothing, send))
    return sent


def status(*headers: tuple[bytes, bytes], **more: Any) -> int:
    return ask("http", *headers, **more)[0]["status"]


@pytest.mark.parametrize("origin", [b"https://evil.example", b"http://127.0.0.1:8001", b"null"])
def test_other_sites_are_refused(origin: bytes) -> None:
    assert status((b"origin", origin)) == 403
    length = (b"content-length", b"5")
    assert status((b"origin", origin), length, method="POST") == 403
    assert ask("websocket", (b"origin", origin)) == [{"type": "websocket.close", "code": 1008}]


def test_the_page_itself_is_let_in_and_so_is_who_follows_a_link() -> None:
    ours = (b"origin", b"http://127.0.0.1:8000")
    assert status(ours) == 200
    assert ask("websocket", ours)[0]["type"] == "websocket.response.start"
    elsewhere = (b"sec-fetch-site", b"cross-site")
    assert status(elsewhere, (b"sec-fetch-dest", b"document")) == 200
    for used in (b"image", b"iframe", b"script"):
        assert status(elsewhere, (b"sec-fetch-dest", used)) == 403


def body(pieces: int, pause: float) -> Callable[[], Any]:
    """A body of so many bytes that come one after the other."""
    left = pieces

    async def receive() -> dict[str, Any]:
        nonlocal left
        await asyncio.sleep(pause)
        left -= 1
        return {"type": "http.request", "body": b"x", "more_body": left > 0}

    return receive


def test_who_sends_too_slowly_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "PATIENCE", 0.2)
    length = (b"content-length", b"100")
    assert status(length, method="POST", receive=body(100, 0.02)) == 408
    assert status(length, method="POST", receive=body(100, 0)) == 200
    monkeypatch.setattr(guard, "SLOWEST", 5)  # bytes a second: 0.2 s more for each of them
    assert status(length, method="POST", receive=body(20, 0.02)) == 200


def test_a_flood_waits_and_a_hand_at_work_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "EVENTS", 10)
    taken: list[float] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        for _ in range(25):
            await receive()
            taken.append(asyncio.get_running_loop().time())

    async def receive() -> dict[str, Any]:
        return {"type": "websocket.receive"}

    scope = {"type": "websocket", "headers": [HOST]}
    asyncio.run(guard.Guard(app, 1000)(scope, receive, None))
    assert taken[9] - taken[0] < 0.9
    assert taken[24] - taken[0] > 1.9
