"""The process of a job: one request as a line on standard input, answers in lines of JSON on standard output."""

import json
import os
import signal
import sys
import threading
from typing import Any, TextIO


def main() -> int:
    """Do the task of the request; 0 if it was done or said why not."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints is no answer
    request = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def tell(**said: Any) -> None:
        answers.write(json.dumps(said) + "\n")
        answers.flush()

    return _do(request, tell, answers)


def _do(request: dict[str, Any], tell: Any, answers: TextIO) -> int:
    from sysid.base.errors import InputError
    from twin.app import tasks

    try:
        tasks.TABLE[request["task"]](request, tell)
    except InputError as error:
        name = str(request.get("data", {}).get("name", "the log"))
        tell(error=str(error).replace(str(request.get("log", "\0")), name))
    except OSError as error:
        tell(
            error=f"a file of this job cannot be read or written ({error.strerror or error}); free disk space, and try "
            "again"
        )
    except MemoryError:
        tell(error="the memory of this machine is not enough for this; give a shorter range, or resample")
    answers.close()
    return 0


def _end_with_parent() -> None:
    """End this process and all that it started as soon as nobody holds the other end of standard input."""
    while os.read(0, 4096):
        pass
    if os.name == "posix" and os.getpgrp() == os.getpid():
        os.killpg(os.getpgrp(), signal.SIGKILL)
    os._exit(1)


if __name__ == "__main__":
    sys.exit(main())
