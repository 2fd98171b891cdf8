"""What a page shows of one moment, made at once, so that nothing changes while it is shown."""

from collections.abc import Sequence
from dataclasses import dataclass

from entrack.looks import coloured
from entrack.tracker import Estimate
from entrack.web import views
from entrack.web.session import Session
from entrack.window import Window, crop

SIDE = 192  # pixels of the pictures of search window and response


@dataclass(frozen=True)
class Details:
    """What stands beside and under the picture."""

    chart: str
    """SVG of the scores."""
    search: str = ""
    """What one object's tracker sees: a picture's address; empty where nothing is known."""
    response: str = ""
    """Its response map, likewise."""


@dataclass(frozen=True)
class Shot:
    """A frame with what is known of it."""

    index: int
    time: float
    length: int
    """Frames that the video has."""
    picture: str
    """The frame as an address that holds it, so that it comes together with its boxes."""
    estimates: Sequence[Estimate | None]
    """Of each object."""
    details: Details | None = None


def take(session: Session, number: int, full: bool = True) -> Shot:
    """Show the frame that a session looks at; with `full` also the details, of object `number`."""
    frame = session.frame
    picture = views.data_url(frame.image, frame.index)
    details = _details(session, number) if full else None
    length = len(session.footage)
    return Shot(frame.index, frame.time, length, picture, session.estimates, details)


def _details(session: Session, number: int) -> Details:
    tracks = [target.estimates for target in session.targets]
    chart = views.chart(tracks, len(session.footage))
    estimate = dict(enumerate(session.estimates)).get(number)
    heat = session.targets[number].heats.get(session.frame.index) if estimate else None
    if estimate is None or heat is None:
        return Details(chart)
    x, y, w, h = estimate.search
    search = crop(session.frame.image, Window(x, y, w, h, SIDE))
    return Details(chart, views.data_url(search), views.data_url(coloured(heat, SIDE)))
