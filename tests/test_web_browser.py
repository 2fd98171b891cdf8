"""The web page in a real Chromium: what a user does, and what comes out."""

import csv
import sys
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

import entrack
from entrack.cli.app import main
from entrack.datasets import open_dataset
from entrack.model import assets
from entrack.video import open_source
from web_page import ARGUMENTS, CHROMIUM, Hands, cpu, running, served

pytest.importorskip("nicegui", reason="needs the extra web")
sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright")
if not CHROMIUM.exists():
    pytest.skip(f"needs a browser: no {CHROMIUM}", allow_module_level=True)

SIZE, FRAMES = (640, 360), 60
BALL, OTHER = (148, 153, 102, 94), (300, 100, 80, 80)
Opener = Callable[..., Hands]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("server")


@pytest.fixture(scope="module")
def address(folder: Path) -> Generator[str, None, None]:
    with served(folder, "--megabytes", "20") as address:
        yield address


@pytest.fixture(scope="module")
def browser() -> Generator[Any, None, None]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def visit(browser: Any, address: str) -> Generator[Opener, None, None]:
    """Opens pages; in the end none of them may have complained in the console."""
    opened: list[Hands] = []

    def visit(**options: Any) -> Hands:
        page = browser.new_page(**{"viewport": {"width": 1280, "height": 900}, **options})
        opened.append(Hands(page, address))
        return opened[-1]

    yield visit
    for hands in opened:
        hands.page.context.close()
    assert [text for hands in opened for text in hands.complaints] == []


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """H.264 with B frames, as a camera makes it."""
    path = tmp_path_factory.mktemp("clip") / "a clip.mp4"
    with (
        open_source(assets() / "demo" / "clip.mp4", stop=FRAMES) as source,
        av.open(str(path), "w") as file,
    ):
        stream = file.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for frame in source:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(frame.image, format="bgr24")))
        file.mux(stream.encode())
    return path


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def boxes_of(rows: list[dict[str, str]]) -> np.ndarray:
    return np.array([[float(row[key]) for key in ("x", "y", "w", "h", "score")] for row in rows])


def test_an_uploaded_video_is_tracked_as_in_the_terminal(
    visit: Opener, clip: Path, tmp_path: Path
) -> None:
    hands = visit()
    hands.upload(str(clip))
    hands.wait_for_video()
    box = hands.drag(BALL, SIZE)
    hands.track()
    shown = hands.download("CSV", tmp_path)
    assert shown.name == "a clip-tracked.csv"
    call = ["track", str(clip), "--box", ",".join(map(repr, box.tolist()))]
    assert main([*call, "--boxes", str(tmp_path / "terminal.csv")]) == 0
    here, there = rows_of(shown), rows_of(tmp_path / "terminal.csv")
    for key in ("frame", "time", "object", "lost"):
        assert [row[key] for row in here] == [row[key] for row in there]
    assert [int(row["frame"]) for row in here] == list(range(FRAMES))
    np.testing.assert_allclose(boxes_of(here), boxes_of(there), atol=1e-3)
    with open_source(hands.download("MP4", tmp_path)) as video:
        assert video.size == SIZE and len(list(video)) == FRAMES
    lines = hands.download("JSONL", tmp_path).read_text().splitlines()
    assert len(lines) == FRAMES


def test_a_corrected_box_is_gone_on_from(visit: Opener, clip: Path, tmp_path: Path) -> None:
    hands = visit()
    hands.upload(str(clip))
    hands.wait_for_video()
    hands.drag(BALL, SIZE)
    hands.track()
    first = boxes_of(rows_of(hands.download("CSV", tmp_path)))
    middle = hands.seek(0.5)
    assert middle == pytest.approx(FRAMES / 2, abs=2)
    box = hands.drag(OTHER, SIZE)
    hands.wait_for(".message:has-text('Press Track')")
    corrected = boxes_of(rows_of(hands.download("CSV", tmp_path)))
    assert len(corrected) == middle + 1  # what was known of later frames no longer holds
    hands.track()
    second = boxes_of(rows_of(hands.download("CSV", tmp_path)))
    np.testing.assert_array_equal(second[:middle], first[:middle])
    np.testing.assert_allclose(second[middle, :4], box, atol=1e-3)
    assert len(second) == FRAMES
    assert np.abs(second[-1, :2] - first[-1, :2]).max() > 20


def test_two_objects(visit: Opener, clip: Path, tmp_path: Path) -> None:
    hands = visit()
    hands.upload(str(clip))
    hands.wait_for_video()
    hands.drag(BALL, SIZE)
    hands.click("Add an object")
    hands.wait_for(".message:has-text('another object')")
    hands.drag(OTHER, SIZE)
    hands.page.wait_for_function("document.querySelectorAll('.object').length === 2")
    hands.track()
    rows = rows_of(hands.download("CSV", tmp_path))
    assert [(int(r["frame"]), int(r["object"])) for r in rows] == [
        (frame, number) for frame in range(FRAMES) for number in (1, 2)
    ]
    hands.click("Remove object 1")
    hands.page.wait_for_function("document.querySelectorAll('.object').length === 1")
    left = rows_of(hands.download("CSV", tmp_path))
    np.testing.assert_array_equal(boxes_of(left), boxes_of(rows[1::2]))


def test_steps_pause_and_keys(visit: Opener, clip: Path) -> None:
    hands = visit()
    hands.upload(str(clip))
    hands.wait_for_video()
    hands.drag(BALL, SIZE)
    for key, frame in (("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1)):
        hands.page.keyboard.press(key)
        hands.wait_for(f".place:has-text('frame {frame} ')")
    assert hands.page.locator(".boxes .box").count() == 1
    hands.click("Track")
    hands.click("Pause")
    hands.wait_for(".track:has-text('Track')")
    place = hands.place
    time.sleep(0.5)
    frame = int(place.split()[1])
    assert hands.place == place and frame < FRAMES - 1
    hands.page.keyboard.press("ArrowLeft")  # the button that was clicked does not keep the keys
    hands.wait_for(f".place:has-text('frame {frame - 1} ')")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("holiday.mp4", b"no video at all", "holiday.mp4 is not a video that can be read"),
        ("list.mp4", b"#EXTM3U\n#EXTINF:1,\n/etc/passwd\n", "list.mp4 is not a video"),
        ("../../etc/cron.mp4", b"x", "cron.mp4 is not a video"),
        ("notes.txt", b"notes", "That is no video file"),
    ],
)
def test_a_wrong_file_is_refused_in_words(
    visit: Opener, folder: Path, name: str, content: bytes, said: str
) -> None:
    hands = visit()
    hands.upload({"name": name, "mimeType": "", "buffer": content})
    hands.wait_for(f".error:has-text('{said}')")
    assert "/" not in hands.page.locator(".error").inner_text()
    hands.click("Try the example")
    hands.wait_for_video()
    outside = [p for p in folder.parent.rglob("*cron*")]
    assert outside == []


def test_a_large_file_is_refused_before_it_is_sent(visit: Opener, tmp_path: Path) -> None:
    hands = visit()
    large = tmp_path / "large.mp4"
    with large.open("wb") as file:
        file.truncate(20_000_001)
    sent: list[str] = []
    hands.page.on("request", lambda request: sent.append(request.method))
    hands.upload(str(large))
    hands.wait_for(".error:has-text('more than 20 MB')")
    assert "POST" not in sent
    assert hands.page.locator(".stage").count() == 0


def test_the_harder_example_loses_its_target_and_says_so(visit: Opener, tmp_path: Path) -> None:
    hands = visit()
    hands.click("Try a harder one")
    hands.wait_for_video()
    sequence = open_dataset("synthetic:hard,count=4")[3]
    hands.drag(sequence.boxes[0], (480, 360))
    hands.click("Track")
    hands.page.wait_for_function(
        "document.querySelector('.object.lost .words')?.innerText === 'LOST'"
        " && document.querySelector('.message.lost')?.innerText.startsWith('Object 1 lost.')"
    )
    hands.wait_for(f".place:has-text('frame {len(sequence) - 1} ')")
    rows = rows_of(hands.download("CSV", tmp_path))
    lost = [int(row["frame"]) for row in rows if int(row["lost"])]
    assert sequence.absent[lost].any()


def test_two_pages_at_once_do_not_mix(visit: Opener, clip: Path, tmp_path: Path) -> None:
    pages, boxes = (visit(), visit()), []
    for hands, box in zip(pages, (BALL, OTHER), strict=True):
        hands.upload(str(clip))
        hands.wait_for_video()
        assert hands.page.locator(".object, .boxes .box").count() == 0
        boxes.append(hands.drag(box, SIZE))
    for hands in pages:
        hands.click("Track")
    for hands, box in zip(pages, boxes, strict=True):
        hands.wait_for(f".place:has-text('frame {FRAMES - 1} ')")
        rows = rows_of(hands.download("CSV", tmp_path))
        alone = [estimate.box for _, estimate in entrack.track(clip, box)]
        np.testing.assert_allclose(boxes_of(rows)[:, :4], alone, atol=1e-3)


def test_closing_a_page_stops_its_work_and_deletes_its_files(browser: Any, tmp_path: Path) -> None:
    call = [sys.executable, "-m", "entrack", "serve", "--no-show", "--port", "0"]
    with running(call, TMPDIR=str(tmp_path)) as (process, address):
        hands = Hands(browser.new_page(), address)
        hands.upload(str(assets() / "demo" / "clip.mp4"))
        hands.wait_for_video()
        hands.drag(BALL, SIZE)
        hands.click("Add an object")
        hands.wait_for(".message:has-text('another object')")
        hands.drag(OTHER, SIZE)
        began = time.monotonic()
        hands.click("Track")
        past = "n => Number(document.querySelector('.place').innerText.split(' ')[1]) > n"
        hands.page.wait_for_function(past, arg=20)
        [upload] = tmp_path.rglob("video.mp4")
        closed, frame = time.monotonic(), hands.frame
        to_the_end = (389 - frame) * (closed - began) / frame
        hands.page.close()
        while upload.parent.exists() and time.monotonic() < closed + 60:
            time.sleep(0.05)
        assert not upload.parent.exists()
        assert time.monotonic() - closed < to_the_end
        used = cpu(process.pid)
        time.sleep(1)
        assert cpu(process.pid) - used < 0.2  # tracking takes most of a second


def test_a_finger_draws_too(visit: Opener) -> None:
    hands = visit(viewport={"width": 390, "height": 800}, has_touch=True, is_mobile=True)
    hands.page.get_by_text("Try the example").tap()
    hands.wait_for_video()
    at = hands.page.locator(".stage").bounding_box()
    touch = hands.page.context.new_cdp_session(hands.page)
    for kind, share in (("touchStart", 0.2), ("touchMove", 0.4), ("touchEnd", None)):
        point = {"x": at["x"] + (share or 0) * at["width"], "y": at["y"] + 60 + 200 * (share or 0)}
        points = [] if share is None else [point]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    hands.wait_for(".boxes .box")
    assert hands.page.evaluate("scrollY") == 0


def test_the_camera_of_the_browser(visit: Opener, tmp_path: Path) -> None:
    hands = visit()
    hands.click("Use the camera")
    hands.wait_for_video()
    hands.drag((200, 100, 150, 150), (640, 480))
    hands.click("Track")
    hands.page.wait_for_function(
        "Number(document.querySelector('.place')?.innerText.split(' ')[1]) > 15"
    )
    hands.click("Pause")
    hands.wait_for(".track:has-text('Track')")
    rows = rows_of(hands.download("CSV", tmp_path))
    assert [int(row["frame"]) for row in rows] == list(range(len(rows))) and len(rows) > 15


def test_select_draws_in_the_browser_and_goes_on_in_the_terminal(
    browser: Any, clip: Path, tmp_path: Path
) -> None:
    out = tmp_path / "boxes.csv"
    call = [sys.executable, "-m", "entrack", "track", str(clip), "--select", "--boxes", str(out)]
    with running(call) as (process, address):
        hands = Hands(browser.new_page(), address, ready=".stage")
        hands.wait_for_video()
        box = hands.drag(BALL, SIZE)
        hands.click("Track")
        hands.wait_for("h2:has-text('Tracking goes on in the terminal')")
        assert process.wait(120) == 0
        hands.page.close()
    rows = rows_of(out)
    assert len(rows) == FRAMES and hands.complaints == []
    np.testing.assert_allclose(boxes_of(rows)[0, :4], box, atol=1e-3)
