"""The process in which files of other programs are read: a damaged one may crash it, and nothing else.

`serve` runs in a process of its own, which has no threads, and forks one more for each file, with limits of time and
memory. That one reads a single file with a single reader, writes what it found as plain numbers and JSON (nothing that
runs), and ends. The answer holds the columns, then a JSON object that says where each of them is, then its length in 8
bytes.
"""

import json
import mmap
import os
import select
import signal
import socket
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table

_TAIL = 8  # bytes of the length


def write_answer(file: int, table: Table | None, **content: Any) -> None:
    """Writes a table, and whatever else is said, into the open file descriptor."""
    place, columns = 0, []
    for values in table.columns if table else ():
        values = np.ascontiguousarray(values)
        columns.append((values.dtype.str, len(values), place))
        _write_all(file, memoryview(values).cast("B") if len(values) else b"")
        place += values.nbytes
    if table:
        content["table"] = {
            "names": table.names,
            "columns": columns,
            "place": table.place,
            "units": dict(table.units),
            "meta": dict(table.meta),
            "notes": table.notes,
            "timed": sorted(table.timed),
            "local": dict(table.local),
            "clocks": dict(table.clocks),
        }
    text = json.dumps(content).encode()
    _write_all(file, text + len(text).to_bytes(_TAIL, "little"))


def read_answer(file: int, path: Path) -> dict[str, Any]:
    """What `write_answer` said, its table as `table`; raises ValueError or KeyError where its end is missing."""
    size = os.fstat(file).st_size
    if size < _TAIL:
        raise ValueError("nothing was written")
    memory = mmap.mmap(file, size, access=mmap.ACCESS_COPY)  # arrays keep it; nothing is copied
    end = size - _TAIL
    length = int.from_bytes(memory[end:], "little")
    content = json.loads(memory[max(0, end - length) : end])
    if "table" in content:
        table = content["table"]
        columns = tuple(np.frombuffer(memory, kind, count, place) for kind, count, place in table["columns"])
        rows = tuple(range(1, len(values) + 1) for values in columns)
        content["table"] = Table(
            path,
            tuple(table["names"]),
            columns,
            rows,
            place=table["place"],
            units=table["units"],
            meta=table["meta"],
            notes=tuple(table["notes"]),
            timed=frozenset(table["timed"]),
            local=table["local"],
            clocks=table["clocks"],
        )
    return content


def _write_all(file: int, raw: Any) -> None:
    rest = memoryview(raw)
    while rest:
        rest = rest[os.write(file, rest) :]


IDLE = 60.0  # [s] after which a server that nobody asks ends


def serve() -> None:
    """Reads the files that are asked for on the socket at descriptor 0, until its other end is closed."""
    requests = socket.socket(fileno=0)
    while select.select([requests], [], [], IDLE)[0]:
        raw, files, *_ = socket.recv_fds(requests, 1 << 20, 1)
        if not raw:
            return
        request = json.loads(raw)
        for library in request["libraries"]:  # once, not in each process
            with suppress(ImportError):
                import_module(library)
        end_of_child, alive = os.pipe()
        process = os.fork()
        if process == 0:
            requests.close()
            read_once(request, files[0])
        os.close(alive)
        os.close(files[0])
        # Who asked is gone, or gives up.
        if requests.fileno() in select.select([requests.fileno(), end_of_child], [], [])[0]:
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
            return
        os.close(end_of_child)
        requests.send(json.dumps(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])).encode())


def read_once(request: dict[str, Any], file: int) -> None:
    """Reads one file, writes what was found to the descriptor and ends the process."""
    with suppress(OSError):
        os.chdir(request["folder"])
    _limit(request["seconds"], request["wait"], request["bytes"])
    path = Path(request["path"])
    try:
        reader = getattr(import_module(request["module"]), request["reader"])()
        table = None if request["head"] else reader.read(path)
        write_answer(file, table, header=reader.header(path))
    except MemoryError:
        write_answer(file, None, memory=True)
    except InputError as error:
        write_answer(file, None, error=str(error))
    except OSError as error:
        write_answer(file, None, errno=error.errno, strerror=error.strerror or str(error))
    except BaseException as error:  # a library's panic is no Exception
        write_answer(file, None, strange=type(error).__name__)
    os._exit(0)


def _limit(seconds: float, wait: float, size: int) -> None:
    """Ends this process after so many seconds of work, or in all, and refuses it more than `size` bytes."""
    with suppress(ImportError):  # Windows has no such limits
        import resource

        signal.alarm(max(1, int(wait)))
        present_size = 0
        with suppress(OSError, ValueError):
            present_size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        limits = {"RLIMIT_CPU": max(1, int(seconds)), "RLIMIT_AS": present_size + size, "RLIMIT_CORE": 0}
        for kind, limit in limits.items():
            number = getattr(resource, kind, None)
            if number is not None:
                hard = resource.getrlimit(number)[1]
                soft = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
                with suppress(OSError, ValueError):
                    resource.setrlimit(number, (soft, hard))
        with suppress(OSError):  # where memory runs out all the same, this process goes first
            Path("/proc/self/oom_score_adj").write_text("1000")


def main() -> None:
    """The one request of a system without fork, as its argument: the answer goes to the file that it names."""
    request = json.loads(sys.argv[-1])
    read_once(request, os.open(request["answer"], os.O_WRONLY | getattr(os, "O_BINARY", 0)))
