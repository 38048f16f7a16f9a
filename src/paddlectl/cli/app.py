"""The command line: its commands, and the one place where errors become exit codes.

Nothing here or at the top of a command's file imports more than Typer and the standard library,
so that `--help` and completion stay quick; and here not even Typer, so that signals are heard before that.
"""

import io
import os
import signal
import sys
import time
from collections.abc import Collection, Sequence
from types import FrameType
from typing import TYPE_CHECKING, NoReturn, TextIO, cast

from paddlectl.cli.quiet import Courtesy
from paddlectl.errors import PaddlectlError

if TYPE_CHECKING:
    import typer

INTERRUPTED = 130
GESTURE = 1.0  # seconds in which ^C, pressed again, means the same; or it would strike what cleans up

# What each command is for, as the docstring of its function says; known here so that `--help` loads none.
COMMANDS = {
    "tasks": "List the tasks that can be trained on and transferred to.",
    "train": "Train sources from scratch and keep them in the registry.",
    "evaluate": "Play a policy on layouts that it never trained on.",
    "watch": "Watch an episode of a policy on an unseen layout, with its subgoals; or make a GIF of it.",
    "policies": "List the policies in the registry, newest first.",
    "runs": "List the runs in the registry, newest first.",
    "show": "Show a policy's clause program, raw and minimised, or a run; and by which numbers it learned.",
    "label": "Give runs a name or tags, to find them by.",
    "similarity": "Show Ψ: for each scene of the target the best scenes of each source, and their ψ.",
    "transfer": "Learn a scenario's target, guided by policies of its sources.",
    "sweep": "Run what is missing of a study, its sources included.",
    "resume": "Go on exactly where a stopped run was; it ends as if it had never been stopped.",
    "compare": "Put methods side by side, with intervals over their seeds.",
    "explain": "Tell why a transfer acted as it did: program, Ψ, weights per scene, two episodes.",
    "export": "Write a run's tables as CSV, Parquet, TensorBoard's events or JSON.",
    "plot": "Draw a study's figure, or a run's curve, as SVG and PNG with the numbers as CSV.",
    "registry": "Check, mend, clean, move and upgrade the registry.",
}
GROUPS = {"registry"}


def make_app(loaded: Collection[str]) -> "typer.Typer":
    """The application with these commands in full, and of the others the name and what they are for."""
    from importlib import import_module

    import typer

    app = typer.Typer(
        name="paddlectl",
        help="Transfer between reinforcement-learning tasks by logic and performance similarity.",
        epilog="Example: paddlectl train BoxDoor && paddlectl show BoxDoor",
        pretty_exceptions_enable=False,
        pretty_exceptions_show_locals=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    shown = typer.Option(
        False, "--version", help="Print the version and exit.", callback=_version, is_eager=True
    )

    @app.callback()
    def paddlectl(version: bool = shown) -> None:
        pass

    for name, purpose in COMMANDS.items():
        if name in loaded:
            module = import_module(f"paddlectl.cli.{name}")
            if name in GROUPS:
                app.add_typer(module.app, name=name, help=purpose, epilog=module.EXAMPLE)
                continue
            app.command(name, help=purpose, epilog=module.EXAMPLE)(getattr(module, name))
        else:
            app.command(name, help=purpose)(_not_loaded)
    return app


def _version(asked: bool) -> None:
    if asked:
        import typer

        import paddlectl

        print(f"paddlectl {paddlectl.__version__}")
        raise typer.Exit


def _not_loaded() -> NoReturn:
    raise AssertionError("only a command that is named is loaded, and no other runs")


def _needed(arguments: Sequence[str]) -> Collection[str]:
    """The command that is named; all of them if the shell asks for completions."""
    return COMMANDS if "_PADDLECTL_COMPLETE" in os.environ else arguments


def main() -> int:
    """Runs one command of the command line and gives its exit code; no exception leaves but SystemExit."""
    _Stopped.number, _Stopped.deaf_until = 0, 0.0
    try:
        code = _main()
    except BaseException as error:
        if not _Stopped.number and not isinstance(error, KeyboardInterrupt):
            raise  # else it is what the signal broke: an import, say, can end in a SyntaxError
        code = INTERRUPTED
        _hear_nothing()
    if not _Stopped.number and code != INTERRUPTED:
        return code
    print("interrupted", file=sys.stderr)
    return 128 + _Stopped.number if _Stopped.number else code


def _main() -> int:
    _hear_signals()
    _mend_streams()
    try:
        code = _run(sys.argv[1:] or ["--help"])
        sys.stdout.flush()
    except BrokenPipeError:
        code = _reader_left()
    _hear_nothing()
    return code


class _Stopped(KeyboardInterrupt):
    """^C, SIGTERM, or a terminal that was closed; what cleans up after ^C cleans up after each."""

    number = 0
    deaf_until = 0.0


def _hear_signals() -> None:
    signal.signal(signal.SIGTERM, _stop)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else a job in the background
        signal.signal(signal.SIGINT, _stop)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_DFL:  # else nohup asked to go on
        signal.signal(signal.SIGHUP, _stop)
    sys.unraisablehook = _not_raised


def _hear_nothing() -> None:
    """At the end: what Python still does then would be told as a traceback."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


def _stop(number: int, _frame: FrameType | None) -> None:
    now = time.monotonic()
    if now >= _Stopped.deaf_until:
        _Stopped.number, _Stopped.deaf_until = number, now + GESTURE
        raise _Stopped


def _not_raised(lost: "sys.UnraisableHookArgs") -> None:
    """A signal that struck where no exception can leave, as in `__del__`, must be given once more."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        _Stopped.number, _Stopped.deaf_until = 0, 0.0
    else:
        sys.__unraisablehook__(lost)


def _mend_streams() -> None:
    """Leads closed streams nowhere, forgets absurd sizes, spells what the streams' encodings lack.

    A file opened while a standard stream is closed would get its number, and what is printed.
    """
    from pathlib import Path

    from paddlectl.report.spelling import ERRORS

    nowhere = Path(os.devnull)
    for size in ("COLUMNS", "LINES"):
        if len(os.environ.get(size, "")) > 4:  # no terminal is so large, and Rich would try to fill it
            del os.environ[size]
    sys.stdin = sys.stdin or nowhere.open()
    sys.stdout = sys.stdout or nowhere.open("w")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=ERRORS)
    if not isinstance(sys.stderr, Courtesy):
        sys.stderr = cast("TextIO", Courtesy(sys.stderr or nowhere.open("w")))


def _run(arguments: Sequence[str]) -> int:
    import typer

    try:
        result = make_app(_needed(arguments))(args=arguments, prog_name="paddlectl", standalone_mode=False)
    except PaddlectlError as error:
        return _told(error.message, error.hint, error.exit_code)
    except ExceptionGroup as group:
        return _told_each(group)
    except typer.TyperException as error:
        return _told(*_usage(error), error.exit_code)
    except typer.Abort:
        return INTERRUPTED
    except BrokenPipeError:
        raise
    except OSError as error:
        return _told(_system(error), "", _emptied())
    except Exception as error:
        return _unexpected(error)
    return result if isinstance(result, int) else 0


def _told(message: str, hint: str, code: int) -> int:
    if _Stopped.number:  # which broke off what now fails
        return code
    from paddlectl.cli.texts import here, one_line, without_secrets

    print(f"error: {one_line(without_secrets(message))}", file=sys.stderr)
    if hint:
        print(one_line(without_secrets(here(hint))), file=sys.stderr)
    return code


def _told_each(group: ExceptionGroup[Exception]) -> int:
    """Of a batch that went on after something in it had failed."""
    for error in group.exceptions:
        _told(error.message, error.hint, 1) if isinstance(error, PaddlectlError) else _unexpected(error)
    return 1


def _usage(error: "typer.TyperException") -> tuple[str, str]:
    """Typer's own complaint, with the nearest name if it knows some."""
    possible = getattr(error, "possibilities", None)
    message = error.message if possible else error.format_message()
    near = f"; did you mean {possible[0]}?" if possible else ""
    context = getattr(error, "ctx", None)
    return f"{message}{near}", f"run: {context.command_path} --help" if context else "run: paddlectl --help"


def _system(error: OSError) -> str:
    what = error.strerror or str(error) or type(error).__name__
    return f"{what}: {os.fsdecode(error.filename)}" if error.filename else what


def _unexpected(error: Exception) -> int:
    import traceback

    from paddlectl.cli.texts import without_secrets

    details = without_secrets("".join(traceback.format_exception(error)))
    if os.environ.get("PADDLECTL_DEBUG"):
        print(details, file=sys.stderr)
        return 1
    log = _write_log(details)
    return _told(f"unexpected {type(error).__name__}: {error}", f"the details are in {log}" if log else "", 1)


def _write_log(text: str) -> str | None:
    import tempfile

    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="paddlectl-", suffix=".log", delete=False, encoding="utf-8", errors="replace"
        ) as log:
            log.write(text)
    except OSError:
        return None
    return log.name


def _emptied() -> int:
    """What stdout can't take is thrown away, or Python would fail on it once more at exit, with 120."""
    try:
        sys.stdout.flush()
    except OSError:
        _reader_left()
    return 1


def _reader_left() -> int:
    """The reader of a pipe has gone (`| head`): says nothing, and lets nothing be said at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 1


if __name__ == "__main__":
    sys.exit(main())
