"""The `entrack` command.

To add a command, write `entrack/cli/NAME.py` with `app = new_app()` and a function under
`@app.command()`, and add a line to `COMMANDS`; several functions make a group, `entrack NAME SUB`.
The module is imported only when the command is called. What the caller can put right is raised as
`EntrackError` (exit code 1), or as `CallError` where the call itself is wrong (2).
"""

import importlib
import io
import sys
import traceback
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import entrack
from entrack.cli.console import CallError, WrongCall, new_app
from entrack.errors import EntrackError

COMMANDS = {
    "demo": "Track the embedded clip, and show what comes out.",
    "track": "Track objects through a video, pictures or a camera.",
    "serve": "Serve a web page: draw a box on a video, and watch it tracked.",
    "explain": "Show what the tracker sees in a frame, as a figure or a film.",
    "train": "Train a policy by maximum-entropy reinforcement learning.",
    "ablate": "Train and score the variants of a policy, with intervals.",
    "evaluate": "Run trackers on benchmarks and score them.",
    "report": "Make curves, tables and pages from scores.",
    "calibrate": "Fit a model's score to your own footage.",
    "bench": "Measure how fast this machine tracks.",
    "data": "List, check and make datasets.",
    "export": "Write a model as ONNX files that run without entrack.",
    "vot": "Prepare a workspace of vot-toolkit.",
    "trunk": "Train, import, quantise and inspect trunks.",
}
"""The only list of commands: name → what it does, in one line."""


class _Commands(TyperGroup):
    """Lists the commands from the table alone, and imports the one that is called."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name, _, rest = super().resolve_command(ctx, args)
        module = importlib.import_module(f"entrack.cli.{name}")
        return name, typer.main.get_command(module.app), rest


app = new_app(cls=_Commands, epilog="--debug, anywhere, shows the traceback of an error.")
for _name, _help in COMMANDS.items():
    app.command(_name, help=_help)(lambda: None)  # its place in the help; see _Commands


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"entrack {entrack.__version__}")
        raise typer.Exit()


@app.callback()
def entrack_(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """Track objects in videos, in real time on a CPU.

    \b
    entrack demo
    entrack track surfer.mp4 --box 125,180,137,167 --video out.mp4
    entrack track frames/ --box 125,180,137,167 --boxes out.csv
    entrack COMMAND --help
    """  # noqa: D301


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line; return 0 for done, 1 for work that failed, 2 for a wrong call."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    words = [word for word in given if word != "--debug"]
    for stream in (sys.stdout, sys.stderr):  # what a terminal cannot show is no reason to end
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")
    try:
        code = typer.main.get_command(app).main(
            words or ["--help"], prog_name="entrack", standalone_mode=False
        )
    except (KeyboardInterrupt, typer.Abort):
        return 130
    except WrongCall as error:
        hint = f". Try '{error.ctx.command_path} --help'." if error.ctx else ""
        bare = type(error).__name__ == "NoArgsIsHelpError"  # its message is the whole help
        why = "expected a COMMAND" if bare else error.format_message().rstrip(".")
        return _failed(why + hint, 2)
    except (EntrackError, OSError) as error:
        if words != given:
            traceback.print_exc()
        return _failed(str(error), 2 if isinstance(error, CallError) else 1)
    return code if isinstance(code, int) else 0


def _failed(why: str, code: int) -> int:
    typer.echo(f"error: {why}", err=True)
    return code
