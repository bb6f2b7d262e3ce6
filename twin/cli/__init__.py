"""`qpal`: one verb a file, no maths; bad input ends in one line and exit code 2."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `qpal` with `arguments` (the process's own if None) and return the exit code.

    0: done. 1: a check of the verb failed. 2: bad input, reported in one line on standard error. 130: stopped.
    """
    from twin.cli.stopping import Stopping

    try:  # importing takes most of a second, in which a person may change their mind
        from typer.exceptions import TyperException

        from sysid.base.errors import InputError
        from twin.cli.app import build
        from twin.cli.console import Stopped
    except KeyboardInterrupt:
        print("qpal: stopped; nothing was written", file=sys.stderr)
        return 130

    kept = "nothing was written"
    given = list(sys.argv[1:] if arguments is None else arguments)
    with Stopping() as stopping:
        try:
            with _named_shell(given):
                code = build()(given or ["--help"], prog_name="qpal", standalone_mode=False)
            sys.stdout.flush()
        except InputError as error:
            return _fail(str(error))
        except TyperException as error:
            command = getattr(getattr(error, "ctx", None), "command_path", "qpal")
            return _fail(f"{error.format_message().rstrip('.')}; see {command} --help")
        except SystemExit as done:  # the script of a completion is printed
            code = done.code
        except BrokenPipeError:
            # The reader of our output went away (`qpal ... | head`): nothing is wrong, and nobody is left to tell.
            sys.stdout = None
            return 0
        except OSError as error:
            return _fail(f"{error.filename or 'output'}: {error.strerror or error}; nothing was written")
        except KeyboardInterrupt:
            stopping.over()
            code = 130
        except Stopped as stopped:
            stopping.over()
            code, kept = 130, str(stopped)
    if code == 130:
        print(f"qpal: stopped; {kept}", file=sys.stderr)
    return code if isinstance(code, int) else 0


def _fail(sentence: str) -> int:
    print("qpal: " + " ".join(sentence.split()), file=sys.stderr)
    return 2


@contextmanager
def _named_shell(given: Sequence[str]) -> Iterator[None]:
    """`--show-completion zsh` names a shell, where typer would look for the one that it runs in and ignore the name.

    Typer has options that take the name too; this variable selects them.
    """
    name = "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION"
    if len(given) != 2 or given[0] not in ("--show-completion", "--install-completion") or name in os.environ:
        yield
        return
    os.environ[name] = "1"
    try:
        yield
    finally:
        del os.environ[name]
