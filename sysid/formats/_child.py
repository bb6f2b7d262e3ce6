"""The process in which files of other programs are read: a damaged one may crash it, and nothing else.

`serve` runs in a process of its own, which has no threads, and forks one more for each file, with limits of time and
memory. That one reads a single file with a single reader, writes what it found, and ends.
"""

import json
import os
import select
import signal
import socket
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from sysid.base.errors import InputError
from sysid.formats import _wire

IDLE = 60.0  # [s] after which a server that nobody asks ends


def serve() -> None:
    """Reads the files that are asked for on the socket at descriptor 0, until its other end is closed."""
    asked = socket.socket(fileno=0)
    while select.select([asked], [], [], IDLE)[0]:
        raw, files, *_ = socket.recv_fds(asked, 1 << 20, 1)
        if not raw:
            return
        request = json.loads(raw)
        for library in request["libraries"]:  # once, not in each process
            with suppress(ImportError):
                import_module(library)
        ended, alive = os.pipe()
        process = os.fork()
        if process == 0:
            asked.close()
            once(request, files[0])
        os.close(alive)
        os.close(files[0])
        if asked.fileno() in select.select([asked.fileno(), ended], [], [])[0]:  # who asked is gone, or gives up
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
            return
        os.close(ended)
        asked.send(json.dumps(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])).encode())


def once(request: dict[str, Any], file: int) -> None:
    """Reads one file, writes what was found to the descriptor and ends the process."""
    with suppress(OSError):
        os.chdir(request["folder"])
    _limit(request["seconds"], request["wait"], request["bytes"])
    path = Path(request["path"])
    try:
        reader = getattr(import_module(request["module"]), request["reader"])()
        table = None if request["head"] else reader.read(path)
        _wire.write(file, table, header=reader.header(path))
    except MemoryError:
        _wire.write(file, None, memory=True)
    except InputError as error:
        _wire.write(file, None, error=str(error))
    except OSError as error:
        _wire.write(file, None, errno=error.errno, strerror=error.strerror or str(error))
    except BaseException as error:  # a library's panic is no Exception
        _wire.write(file, None, strange=type(error).__name__)
    os._exit(0)


def _limit(seconds: float, wait: float, size: int) -> None:
    """Ends this process after so many seconds of work, or in all, and refuses it more than `size` bytes."""
    with suppress(ImportError):  # Windows has no such limits
        import resource

        signal.alarm(max(1, int(wait)))
        used = 0
        with suppress(OSError, ValueError):
            used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        for kind, most in (("RLIMIT_CPU", max(1, int(seconds))), ("RLIMIT_AS", used + size), ("RLIMIT_CORE", 0)):
            number = getattr(resource, kind, None)
            if number is not None:
                hard = resource.getrlimit(number)[1]
                soft = most if hard == resource.RLIM_INFINITY else min(most, hard)
                with suppress(OSError, ValueError):
                    resource.setrlimit(number, (soft, hard))
        with suppress(OSError):  # where memory runs out all the same, this process goes first
            Path("/proc/self/oom_score_adj").write_text("1000")


def main() -> None:
    """The one request of a system without fork, as its argument: the answer goes to the file that it names."""
    request = json.loads(sys.argv[-1])
    once(request, os.open(request["answer"], os.O_WRONLY | getattr(os, "O_BINARY", 0)))
