"""A visitor of the page without a browser: NiceGUI's protocol from the other side.

It reads the page's elements, keeps them up to date by what the server sends over the websocket,
presses buttons and drags boxes by the events that a browser would send, uploads and downloads.
"""

import asyncio
import contextlib
import html
import json
import re
import uuid
from collections.abc import Callable
from typing import Any

import aiohttp
import socketio

Element = dict[str, Any]
Test = Callable[[Element], bool]


class Visitor:
    """One page, from opening to closing."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.elements: dict[str, Element] = {}
        self.downloads: list[dict[str, Any]] = []
        self.notes: list[str] = []
        """What the page has complained of."""
        self.pictures = 0
        self.lost = 0
        """How often the connection broke."""
        self.on_picture: Callable[[str], None] = lambda source: None
        self._changed = asyncio.Event()
        self._seen = 0
        # As in a browser, the websocket has a connection to itself: one that has served a page
        # before is sometimes closed as unused, though it is a websocket by then (uvicorn 0.54).
        self._http = aiohttp.ClientSession(connector=aiohttp.TCPConnector(force_close=True))
        self._socket = socketio.AsyncClient(http_session=self._http, reconnection=False)

    async def open(self) -> "Visitor":
        """Get the page and connect."""
        async with self._http.get(self.address) as answer:
            page = await answer.text()
            assert answer.status == 200, f"the page answers {answer.status}"
        found = re.search(r"parseElements\(String\.raw`(.*?)`\)", page, re.DOTALL)
        query = re.search(r"query: (\{.*?\}),\n", page)
        assert found and query, "this is not the page"
        self.elements = json.loads(html.unescape(found[1]))
        options = json.loads(query[1].replace("'", '"').replace("True", "true"))
        self.client = options["client_id"]
        options |= {"document_id": str(uuid.uuid4()), "tab_id": str(uuid.uuid4())}
        options["implicit_handshake"] = "true"
        for name in ("update", "download", "notify"):
            self._socket.on(name, getattr(self, f"_{name}"))
        self._socket.on("disconnect", self._disconnected)
        words = "&".join(f"{key}={value}" for key, value in options.items())
        await self._socket.connect(
            f"{self.address}?{words}",
            socketio_path="/_nicegui_ws/socket.io",
            transports=["websocket"],
            headers={"Origin": self.address},
            wait_timeout=60,
        )
        self._acks = asyncio.create_task(self._acknowledge())
        return self

    async def close(self) -> None:
        """Leave."""
        self._acks.cancel()
        self._socket.handlers["/"].pop("disconnect", None)
        await self._socket.disconnect()
        await self._http.close()

    async def __aenter__(self) -> "Visitor":
        return await self.open()

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    # What the server says.

    def _heard(self, message: dict[str, Any]) -> None:
        self._seen = message.pop("_id", self._seen - 1) + 1
        self._changed.set()

    async def _update(self, message: dict[str, Any]) -> None:
        self._heard(message)
        for key, element in message.items():
            if element is None:
                self.elements.pop(key, None)
                continue
            before = self.elements.get(key, {}).get("props", {}).get("src")
            self.elements[key] = element
            source = element.get("props", {}).get("src", "")
            if source != before and source.startswith("data:image/jpeg;n="):
                self.pictures += 1
                self.on_picture(source)
                with contextlib.suppress(KeyError):  # a picture that has nothing to say when loaded
                    await self._emit(key, element, "loaded")

    async def _download(self, message: dict[str, Any]) -> None:
        self._heard(message)
        self.downloads.append(message)

    async def _notify(self, message: dict[str, Any]) -> None:
        self._heard(message)
        self.notes.append(str(message.get("message")))

    async def _disconnected(self, *_: object) -> None:
        self.lost += 1
        self._changed.set()

    async def _acknowledge(self) -> None:
        while True:
            await asyncio.sleep(3)
            message = {"client_id": self.client, "next_message_id": self._seen}
            await self._socket.emit("ack", message)

    # What the visitor sees and does.

    def find(self, test: Test) -> tuple[str, Element]:
        """Number and content of the first such element."""
        for key, element in list(self.elements.items()):
            if test(element):
                return key, element
        raise KeyError("there is no such element")

    def sees(self, test: Test) -> bool:
        """Whether there is such an element."""
        return any(test(element) for element in self.elements.values())

    @property
    def texts(self) -> list[str]:
        """What stands on the page."""
        return [str(e["text"]) for e in self.elements.values() if e.get("text")]

    async def until(self, what: Callable[[], object], seconds: float = 300) -> None:
        """Wait until something holds."""
        async with asyncio.timeout(seconds):
            while not what():
                assert not self.lost, "the connection was lost"
                self._changed.clear()
                await self._changed.wait()

    async def press(self, test: Test) -> None:
        """Click on an element."""
        await self._emit(*self.find(test), "click")

    async def drag(self, ends: tuple[float, float, float, float]) -> None:
        """Draw a box, its corners in shares of the picture."""
        key, stage = self.find(of_class("stage"))
        x0, y0, x1, y1 = ends
        await self._emit(key, stage, "pointerdown", "pointerdown", x0, y0)
        await self._emit(key, stage, "pointermove", "pointermove", (x0 + x1) / 2, (y0 + y1) / 2)
        await self._emit(key, stage, "pointerup", "pointerup", x1, y1)

    async def _emit(self, key: str, element: Element, kind: str, *args: Any) -> None:
        listeners = [e for e in element.get("events", []) if e["type"] == kind]
        if not listeners:
            raise KeyError(f"nobody listens to {kind}")
        for listener in listeners:
            words = [json.dumps(a) for a in args] or ["{}"]
            message = {"id": int(key), "client_id": self.client, "args": words}
            await self._socket.emit("event", message | {"listener_id": listener["listener_id"]})

    async def say(self, event: str, message: Any) -> None:
        """Send anything at all."""
        await self._socket.emit(event, message)

    @property
    def upload_address(self) -> str:
        """Where files are posted to."""
        return self.address + self.find(lambda e: e["tag"] == "nicegui-upload")[1]["props"]["url"]

    async def upload(self, name: str, content: bytes) -> int:
        """Send a file; return the status of the answer."""
        form = aiohttp.FormData(quote_fields=False)
        form.add_field("file", content, filename=name, content_type="video/mp4")
        async with self._http.post(self.upload_address, data=form) as answer:
            await answer.read()
            return answer.status

    async def fetch(self, kind: str) -> bytes:
        """Press a download's button, and get what it offers."""
        count = len(self.downloads)
        await self.press(labelled(kind))
        await self.until(lambda: len(self.downloads) > count)
        async with self._http.get(self.address + self.downloads[-1]["src"]) as answer:
            assert answer.status == 200, f"a download answers {answer.status}"
            return await answer.read()


def of_class(name: str) -> Test:
    """Elements of a class."""
    return lambda element: name in element.get("class", [])


def labelled(text: str) -> Test:
    """Elements with a label."""
    return lambda element: element.get("props", {}).get("label") == text
