"""What stands before the page: limits on who asks, with how much, how slowly and how often."""

import asyncio
from typing import Any

from starlette.responses import PlainTextResponse

PATIENCE = 30.0
"""Seconds that a request may take, and …"""
SLOWEST = 20_000
"""… bytes a second that it has to send after that."""
EVENTS = 200
"""Messages of a websocket that are taken in a second; a hand at work makes some 70."""


class Guard:
    """ASGI middleware: refuse other sites, and what is too large or too slow; pace websockets.

    A page of another site may not use this one through its visitor's browser: browsers say from
    where they ask. Messages that come too fast are left waiting on the sender's side.

    Parameters
    ----------
    largest
        Bytes of a request.
    """

    def __init__(self, app: Any, largest: int) -> None:
        self._app, self._largest = app, largest

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Answer a request, or hand it on."""
        if scope["type"] not in ("http", "websocket"):
            return await self._app(scope, receive, send)
        headers: dict[bytes, bytes] = dict(scope["headers"])
        if scope["type"] == "websocket":
            if _foreign(headers):
                return await send({"type": "websocket.close", "code": 1008})
            return await self._app(scope, _paced(receive), send)
        if _foreign(headers):
            return await PlainTextResponse("not for other sites", 403)(scope, receive, send)
        if scope["method"] in ("GET", "HEAD"):
            return await self._app(scope, receive, send)
        length = headers.get(b"content-length", b"")
        if not length.isdigit() or int(length) > self._largest:
            refusal = PlainTextResponse(f"more than {self._largest} bytes", 413)
            return await refusal(scope, receive, send)
        return await self._patiently(scope, receive, send)

    async def _patiently(self, scope: Any, receive: Any, send: Any) -> None:
        """Give up a request whose body comes too slowly."""
        answered, now = False, asyncio.get_running_loop().time
        began, size, whole = now(), 0, False

        async def wait() -> Any:
            nonlocal size, whole
            if not whole:
                limit.reschedule(began + PATIENCE + size / SLOWEST)
            message = await receive()
            limit.reschedule(None)
            size += len(message.get("body", b""))
            whole = not message.get("more_body", False)
            return message

        async def answer(message: Any) -> None:
            nonlocal answered
            answered = True
            await send(message)

        try:
            async with asyncio.timeout(None) as limit:
                await self._app(scope, wait, answer)
        except TimeoutError:
            if not answered:
                await PlainTextResponse("too slow", 408)(scope, receive, send)


def _foreign(headers: dict[bytes, bytes]) -> bool:
    """Whether a browser asks for a page of another site, other than by following a link."""
    origin = headers.get(b"origin")
    if origin is not None:
        ours = (headers.get(b"host"), headers.get(b"x-forwarded-host"))
        return origin.partition(b"://")[2] not in ours
    linked = headers.get(b"sec-fetch-dest") == b"document"
    return headers.get(b"sec-fetch-site") == b"cross-site" and not linked


def _paced(receive: Any) -> Any:
    """`receive`, so many times a second at most."""
    now = asyncio.get_running_loop().time
    second, count = now(), 0

    async def paced() -> Any:
        nonlocal second, count
        message = await receive()
        count += 1
        if now() - second >= 1:
            second, count = now(), 1
        elif count > EVENTS:
            await asyncio.sleep(second + 1 - now())
            second, count = now(), 1
        return message

    return paced
