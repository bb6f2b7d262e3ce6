"""`qpal`: one verb a file, no maths; bad input ends in one line and exit code 2."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext

from twin.cli import environment
from twin.cli.stopping import Stopping, caused_by, exit_on_signal, stay_ignored


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `qpal` with `arguments` (the process's own if None) and return the exit code.

    0: done. 1: a check of the verb failed. 2: bad input, or an output that cannot be written, reported in one line on
    standard error. 130: stopped; the line says what was written.
    """
    try:
        with Stopping(program=arguments is None) as stopping, environment.within_reason(), environment.streams():
            if sentence := environment.no_room() or environment.no_threads():  # before the libraries load
                return _fail(sentence)
            return _run(arguments, stopping)
    except KeyboardInterrupt:  # before the first line of the run, or after its last
        from twin.cli.results import outcome

        return _report_stop(outcome())


def _run(arguments: Sequence[str] | None, stopping: Stopping) -> int:
    """The exit code of the verb that `arguments` name; every way in which a run ends is told here."""
    # Importing takes most of a second, in which a person may change their mind.
    with exit_on_signal(_NOTHING) if arguments is None else nullcontext():
        from typer.exceptions import TyperException

        from sysid.base.errors import InputError
        from twin.cli import results
        from twin.cli.app import command_line
        from twin.cli.console import Interruption

        stay_ignored()
    results.begin()
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with _named_shell(words) as named:
            code = command_line(named)(words or ["--help"], prog_name="qpal", standalone_mode=False)
        environment.flush()
    except (KeyboardInterrupt, Interruption) as stopped:
        stopping.finish()
        return _report_stop(str(stopped) or results.outcome(), stopping.why)
    except BaseException as error:
        if stopping.asked:  # a library made an error of its own of the interrupt
            stopping.finish()
            return _report_stop(results.outcome(), stopping.why)
        if isinstance(error, (OSError, SystemExit)) and caused_by(error, BrokenPipeError):
            # The reader of our output went away (`qpal ... | head`): nothing is wrong, and nobody is left to tell.
            environment.drop()
            return 0
        if isinstance(error, SystemExit):  # the script of a completion is printed
            code = error.code
        elif isinstance(error, InputError):
            return _fail(str(error))
        elif isinstance(error, TyperException):
            command = getattr(getattr(error, "ctx", None), "command_path", "qpal")
            text = str(InputError(error.format_message().rstrip(".")))  # a long or strange text is cut there
            return _fail(f"{text}; see {command} --help")
        elif isinstance(error, OSError):
            environment.drop()
            return _fail(f"{error.filename or 'output'}: {error.strerror or error}; {results.outcome()}")
        else:
            raise
    if code == 130:  # the interrupt, as typer says it
        stopping.finish()
        return _report_stop(results.outcome(), stopping.why)
    return code if isinstance(code, int) else 0


_NOTHING = "qpal: stopped; nothing was written"


def _report_stop(outcome: str, reason: str = "") -> int:
    environment.say(f"qpal: stopped{reason}; {outcome}")
    return 130


def _fail(sentence: str) -> int:
    environment.say("qpal: " + " ".join(sentence.split()))
    return 2


@contextmanager
def _named_shell(words: Sequence[str]) -> Iterator[bool]:
    """`--show-completion zsh` names a shell, where typer would look for the one that it runs in and ignore the name.

    Typer has options that take the name too; this variable selects them while the command line is built.
    """
    name = "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION"
    if len(words) != 2 or words[0] not in ("--show-completion", "--install-completion") or name in os.environ:
        yield False
        return
    os.environ[name] = "1"
    try:
        yield True
    finally:
        del os.environ[name]
