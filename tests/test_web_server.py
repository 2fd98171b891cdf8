"""The server from outside: who is let in, and with how much."""

import http.client
import socket
import tempfile
import time
from collections.abc import Generator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from entrack.cli.app import main
from web_page import served

pytest.importorskip("nicegui", reason="needs the extra web")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Generator[str, None, None]:
    with served(tmp_path_factory.mktemp("server"), "--megabytes", "1") as address:
        yield address


def ask(
    address: str, path: str, method: str = "GET", body: bytes = b"", **headers: str
) -> tuple[int, bytes]:
    place = urlsplit(address)
    connection = http.client.HTTPConnection(str(place.hostname), place.port, timeout=60)
    for _ in range(100):
        try:
            connection.connect()
            break
        except ConnectionRefusedError:
            connection.close()
            time.sleep(0.2)
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    return answer.status, answer.read()


def test_the_page_needs_nothing_from_elsewhere(address: str) -> None:
    status, page = ask(address, "/")
    assert status == 200 and address.startswith("http://127.0.0.1:")
    for attribute in (b'src="http', b'href="http', b"//cdn", b"fonts.googleapis"):
        assert attribute not in page


def test_only_this_machines_names_are_answered(address: str) -> None:
    assert ask(address, "/", Host="evil.example")[0] == 400
    assert ask(address, "/", Host="localhost")[0] == 200


def test_too_much_is_refused_unread(address: str) -> None:
    assert ask(address, "/camera/x", "POST", b"1" * 100)[0] == 410
    declared = {"Content-Length": str(10**9)}
    assert ask(address, "/camera/x", "POST", b"", **declared)[0] == 413
    assert ask(address, "/camera/x", "POST", b"", **{"Transfer-Encoding": "chunked"})[0] == 413


@pytest.mark.parametrize("path", ["/frame/none/1", "/../../etc/passwd", "/%2e%2e/etc/passwd"])
def test_nothing_else_is_served(address: str, path: str) -> None:
    status, body = ask(address, path)
    assert status == 404 and b"root:" not in body


def test_a_taken_port_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["serve", "--no-show", "--port", str(port)]) == 1
    assert f"cannot listen on 127.0.0.1:{port}" in capsys.readouterr().err


def test_the_scratch_folder_is_gone_in_the_end_and_temporary_files_go_elsewhere() -> None:
    from entrack.web.server import scratch

    before = tempfile.gettempdir()
    with scratch() as folder:
        with tempfile.NamedTemporaryFile() as file:
            assert Path(file.name).parent == Path(folder)
    assert not Path(folder).exists() and tempfile.gettempdir() == before


def test_a_wrong_model_is_said_before_anything_is_served(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["serve", "--no-show", "--model", str(tmp_path / "none")]) == 2
    assert "none" in capsys.readouterr().err
