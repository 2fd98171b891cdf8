"""What a page works on: objects are added, corrected and removed while time goes to and fro."""

import weakref
from collections.abc import Generator
from pathlib import Path

import numpy as np
import pytest

import entrack
from entrack import EntrackError
from entrack.model import assets
from entrack.tracker import Estimate
from entrack.video import Clip, open_source
from entrack.web.session import Session

pytest.importorskip("nicegui", reason="needs the extra web")
from entrack.web import views
from entrack.web.camera import Recording

CLIP = assets() / "demo" / "clip.mp4"
CUP, OTHER = (148, 153, 102, 94), (286, 153, 102, 94)


@pytest.fixture
def session() -> Generator[Session, None, None]:
    with Session(Clip(CLIP), entrack.load(threads=1)) as session:
        yield session


def run(session: Session, frames: int) -> None:
    for _ in range(frames):
        assert session.forward()


def boxes_of(session: Session, number: int) -> dict[int, list[float]]:
    return {i: e.box.tolist() for i, e in session.targets[number].estimates.items()}


def test_each_object_is_tracked_as_if_it_were_alone(session: Session) -> None:
    session.put(0, CUP)
    session.put(1, OTHER)
    run(session, 6)
    tracker = entrack.load(threads=1)
    for number, box in enumerate((CUP, OTHER)):
        with open_source(CLIP, stop=7) as source:
            tracker.init(source.first.image, box)
            alone = [box, *(tracker.update(f.image).box for f in source if f.index)]
        np.testing.assert_allclose(list(boxes_of(session, number).values()), alone)


def test_correcting_one_object_leaves_the_others_as_they_are(session: Session) -> None:
    session.put(0, CUP)
    session.put(1, OTHER)
    run(session, 6)
    first, second = boxes_of(session, 0), boxes_of(session, 1)
    session.go(3)
    session.put(0, OTHER)
    assert sorted(session.targets[0].estimates) == [0, 1, 2, 3]
    run(session, 3)
    assert boxes_of(session, 1) == second
    corrected = boxes_of(session, 0)
    assert sorted(corrected) == list(range(7))
    assert [corrected[i] for i in range(3)] == [first[i] for i in range(3)]
    assert corrected[3] == list(OTHER) and corrected[6] != first[6]


def test_going_back_does_not_track_again(session: Session) -> None:
    session.put(0, CUP)
    run(session, 4)
    known = dict(session.targets[0].estimates)
    session.go(1)
    assert not session.fresh
    run(session, 2)
    assert session.targets[0].estimates == known
    run(session, 2)
    assert session.fresh and sorted(session.targets[0].estimates) == [0, 1, 2, 3, 4, 5]


def test_an_object_may_begin_later(session: Session, tmp_path: Path) -> None:
    session.put(0, CUP)
    run(session, 3)
    session.put(1, OTHER)
    run(session, 2)
    session.write_boxes(tmp_path / "boxes.csv")
    rows = [line.split(",") for line in (tmp_path / "boxes.csv").read_text().splitlines()[1:]]
    places = [(int(row[0]), int(row[2])) for row in rows]
    assert places == [(0, 1), (1, 1), (2, 1), (3, 1), (3, 2), (4, 1), (4, 2), (5, 1), (5, 2)]
    for _ in session.write_video(tmp_path / "boxes.mp4"):
        pass
    with open_source(tmp_path / "boxes.mp4") as video:
        assert len(list(video)) == 6


def test_playing_where_nothing_is_known_goes_on_where_something_is(session: Session) -> None:
    session.put(0, CUP)
    run(session, 2)
    session.go(100)
    session.resume()
    run(session, 1)
    assert session.frame.index == 3 and session.estimates[0] is not None


def test_the_end_and_a_box_outside(session: Session) -> None:
    session.go(10**6)
    assert session.frame.index == len(session.footage) - 1
    session.put(0, CUP)
    assert not session.forward()
    with pytest.raises(EntrackError, match="outside"):
        session.put(1, (1000, 1000, 20, 20))
    assert len(session.targets) == 1


def test_a_closed_session_holds_no_tracker() -> None:
    tracker = entrack.load(threads=1)
    session = Session(Clip(CLIP), tracker)
    session.put(0, CUP)
    held = [weakref.ref(tracker), weakref.ref(session.targets[0].tracker)]
    del tracker
    session.close()
    assert [reference() for reference in held] == [None, None]


def test_a_recording_grows_and_ends_when_it_is_full(tmp_path: Path) -> None:
    jpeg = views.jpeg(np.full((48, 64, 3), 90, np.uint8))
    recording = Recording(tmp_path, jpeg, largest=2.5 * len(jpeg))
    assert recording.size == (64, 48) and len(recording) == 1
    recording.restart(jpeg)
    recording.add(jpeg)
    assert len(recording) == 2 and not recording.full
    recording.add(jpeg)
    assert recording.full and recording[2].image.shape == (48, 64, 3)
    with pytest.raises(EntrackError, match="no picture"):
        Recording(tmp_path, b"<html>", 1e6)


def estimate(box: tuple[float, ...], lost: bool = False, sigma: float | None = None) -> Estimate:
    spread = None if sigma is None else np.full(4, sigma)
    return Estimate(np.array(box, float), 0.25, lost, spread, None, np.array([0, 0, 9, 9.0]), 1.0)


def test_boxes_lie_where_they_belong() -> None:
    html = views.boxes([None, estimate((20, 30, 40, 60), lost=True)], (200, 300))
    place = "left:10.000%;top:10.000%;width:20.000%;height:20.000%"
    assert f'class="box lost" style="{place};--ink:{views.colour(1)}"' in html
    assert "2 lost" in html and "band" not in html
    band = views.boxes([estimate((20, 30, 40, 60), sigma=10)], (200, 300))
    assert "left:5.000%;top:6.667%;width:30.000%;height:26.667%" in band


def test_the_curve_shows_scores_gaps_and_losses() -> None:
    track = {i: estimate((1, 1, 5, 5), lost=i > 7) for i in (0, 1, 5, 6, 7, 8, 9, 10)}
    svg = views.chart([track], 11)
    assert svg.count("<polyline") == 2  # one for each run of frames
    assert 'points="0.0,75.0 100.0,75.0"' in svg
    assert svg.count('class="lost"') == 1 and 'x="750.0" width="250.0"' in svg
