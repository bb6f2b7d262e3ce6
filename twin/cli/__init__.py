"""`qpal`: one verb a file, no maths; bad input ends in one line and exit code 2."""

import signal
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `qpal` with `arguments` (the process's own if None) and return the exit code.

    0: done. 1: a check of the verb failed. 2: bad input, reported in one line on standard error. 130: stopped.
    """
    from typer.exceptions import TyperException

    from sysid.base.errors import InputError
    from twin.cli.app import build
    from twin.cli.console import Stopped

    kept = "nothing was written"
    previous = _stop_on_terminate()
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        code = build()(given or ["--help"], prog_name="qpal", standalone_mode=False)
        sys.stdout.flush()
    except InputError as error:
        return _fail(str(error))
    except TyperException as error:
        command = getattr(getattr(error, "ctx", None), "command_path", "qpal")
        return _fail(f"{error.format_message().rstrip('.')}; see {command} --help")
    except BrokenPipeError:
        # The reader of our output went away (`qpal ... | head`): nothing is wrong, and nobody is left to tell.
        sys.stdout = None
        return 0
    except OSError as error:
        return _fail(f"{error.filename or 'output'}: {error.strerror or error}; nothing was written")
    except KeyboardInterrupt:
        code = 130
    except Stopped as stopped:
        code, kept = 130, str(stopped)
    finally:
        if previous is not None:
            signal.signal(signal.SIGTERM, previous)
    if code == 130:
        print(f"qpal: stopped; {kept}", file=sys.stderr)
    return code if isinstance(code, int) else 0


def _fail(sentence: str) -> int:
    print("qpal: " + " ".join(sentence.split()), file=sys.stderr)
    return 2


def _stop_on_terminate():
    """Makes SIGTERM clean up like Ctrl-C; returns the former handler, or None outside the main thread."""

    def stop(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    try:
        return signal.signal(signal.SIGTERM, stop)
    except ValueError:
        return None
