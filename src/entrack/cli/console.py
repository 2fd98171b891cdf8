"""What the commands share: options, errors of the call, and the progress bar."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

import typer

from entrack.errors import EntrackError

WrongCall: Any = typer.BadParameter.__base__
"""What typer raises for words that it cannot parse; typer has no public name for it."""

STILLS: Any = typer.Option(
    metavar="DIR", exists=True, file_okay=False, help="Pictures of anything."
)
CUTOUTS: Any = typer.Option(
    metavar="DIR",
    exists=True,
    file_okay=False,
    help="Folder with train/, masks/ and images/ to cut from.",
)


class CallError(EntrackError):
    """The command was called with something that it cannot use: exit code 2."""


def new_app(**options: Any) -> typer.Typer:
    """Make the app of one command: plain help that keeps examples as they are."""
    return typer.Typer(add_completion=False, rich_markup_mode=None, **options)


@contextmanager
def checking_call() -> Generator[None, None, None]:
    """Make an `EntrackError` in the block an error of the call, unless the system refused."""
    try:
        yield
    except EntrackError as error:
        if isinstance(error.__cause__, OSError):
            raise
        raise CallError(str(error)) from error


@contextmanager
def progress(label: str, total: float | None) -> Generator[Callable[[], None], None, None]:
    """Show a bar on stderr with rate and time left; the function that it yields moves it by one."""
    from rich import progress as bar
    from rich.console import Console
    from rich.text import Text

    class Rate(bar.ProgressColumn):
        def render(self, task: bar.Task) -> Text:
            speed = task.finished_speed or task.speed
            return Text("" if speed is None else f"{speed:.0f}/s")

    columns = (
        bar.TextColumn("{task.description}"),
        bar.BarColumn(),
        bar.MofNCompleteColumn(),
        Rate(),
        bar.TimeRemainingColumn(elapsed_when_finished=True),
    )
    with bar.Progress(*columns, console=Console(stderr=True)) as shown:
        task = shown.add_task(label, total=total)
        yield lambda: shown.advance(task)


@contextmanager
def stages() -> Generator[Callable[[str, int, int, dict[str, float]], None], None, None]:
    """A bar on stderr for each stage of training, with its losses and the time left."""
    from rich import progress as bar
    from rich.console import Console

    columns = (
        bar.TextColumn("{task.description}"),
        bar.BarColumn(),
        bar.MofNCompleteColumn(),
        bar.TimeRemainingColumn(elapsed_when_finished=True),
        bar.TextColumn("{task.fields[values]}"),
    )
    with bar.Progress(*columns, console=Console(stderr=True)) as shown:
        tasks: dict[str, bar.TaskID] = {}

        def report(stage: str, step: int, steps: int, values: dict[str, float]) -> None:
            if stage not in tasks:
                tasks[stage] = shown.add_task(stage, total=steps, values="")
            text = "  ".join(f"{name} {value:.4g}" for name, value in values.items())
            shown.update(tasks[stage], completed=step, values=text)

        yield report
