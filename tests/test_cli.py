"""The `entrack` command as a whole: help, errors, exit codes, laziness."""

import subprocess
import sys

import pytest
import typer

import entrack
from entrack import EntrackError
from entrack.cli import app as cli
from entrack.cli.app import COMMANDS, main
from entrack.cli.console import CallError, checking_call, new_app


def run_python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout


def test_help_lists_every_command_by_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    for name, line in COMMANDS.items():
        assert f"  {name} " in shown and line in shown
    assert "entrack track surfer.mp4 --box" in shown
    assert main([]) == 0
    assert capsys.readouterr().out == shown


def test_help_imports_no_command_and_nothing_heavy() -> None:
    code = "import sys; from entrack.cli.app import main; main(['--help']); print(*sys.modules)"
    loaded = run_python(code).splitlines()[-1].split()
    assert not {f"entrack.cli.{name}" for name in COMMANDS} & set(loaded)
    assert not {"openvino", "av", "torch", "matplotlib", "rich"} & set(loaded)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"entrack {entrack.__version__}\n"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (["trakc"], "No such command 'trakc'. Did you mean 'track'"),
        (["track"], "expected a SOURCE, or a --batch. Try 'entrack track --help'."),
        (["track", "x.mp4"], "either --box X,Y,W,H or --select"),
        (["track", "x.mp4", "--box", "1,2,3,4", "--start", "soon"], "Invalid value for '--start'"),
        (["--verbose"], "No such option"),
        (["data"], "expected a COMMAND. Try 'entrack data --help'."),
    ],
)
def test_wrong_call_is_one_line_and_code_2(
    call: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(call) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith("error: ") and message in shown.err
    assert len(shown.err.splitlines()) == 1 and not shown.out


class FakeModule:
    """A command that raises what it was made with."""

    def __init__(self, error: BaseException | None) -> None:
        self.app = new_app()

        @self.app.command()
        def fail() -> None:
            if error is not None:
                raise error


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (None, 0, ""),
        (EntrackError("it broke"), 1, "error: it broke\n"),
        (CallError("not like this"), 2, "error: not like this\n"),
        (OSError(28, "No space left on device"), 1, "error: [Errno 28] No space left on device\n"),
        (KeyboardInterrupt(), 130, ""),
        (typer.Exit(3), 3, ""),
    ],
)
def test_exit_codes(
    error: BaseException | None,
    code: int,
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(cli.importlib, "import_module", lambda name: FakeModule(error))
    assert main(["bench"]) == code
    assert capsys.readouterr().err == message


@pytest.mark.parametrize("call", [["--debug", "bench"], ["bench", "--debug"]])
def test_debug_shows_the_traceback(
    call: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli.importlib, "import_module", lambda name: FakeModule(EntrackError("no")))
    assert main(call) == 1
    shown = capsys.readouterr().err
    assert "Traceback" in shown and shown.endswith("error: no\n")


def test_a_bug_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli.importlib, "import_module", lambda name: FakeModule(TypeError("bug")))
    with pytest.raises(TypeError, match="bug"):
        main(["bench"])


def test_errors_of_the_call_but_not_of_the_system_have_code_2() -> None:
    with pytest.raises(CallError, match="no such thing"), checking_call():
        raise EntrackError("no such thing")
    with pytest.raises(EntrackError) as error, checking_call():
        raise EntrackError("cannot write") from PermissionError()
    assert not isinstance(error.value, CallError)
