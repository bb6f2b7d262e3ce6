"""Files of other programs, read in a process of its own, so that a damaged one is a sentence whatever its reader does.

On Linux the process that is started for the first file stays for a minute and forks one for each file; elsewhere each
file has its own. It ends as soon as this process does, in whatever way that is.
"""

import atexit
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.spawn import get_executable
from pathlib import Path
from threading import Lock
from typing import Any, Protocol

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats._sandbox_child import read_answer

# Far above what sound files need: a bag of small messages takes 2 s and a compressed table 0.1 GB for each MB.
SECONDS, SECONDS_PER_BYTE = 60.0, 1e-5  # of work
WAIT = 60.0  # [s] for disks and other programs
BYTES, BYTES_PER_BYTE, BYTES_PER_CORE = 4 << 30, 100, 256 << 20
FORKS = sys.platform == "linux"  # elsewhere system libraries have threads, which a fork would lose


class Foreign(Protocol):
    """A format whose files libraries of others read: what runs in the other process, and what is loaded there first."""

    def read(self, path: Path) -> Table:
        """The columns of the file."""
        ...

    def header(self, path: Path) -> str:
        """The header of the file."""
        ...

    @staticmethod
    def libraries(path: Path) -> tuple[str, ...]:
        """The modules that read this file."""
        ...


def read(path: Path, reader: type[Foreign]) -> tuple[Table, str]:
    """The table and the header of the file, by a reader of other programs' files. Raises InputError or OSError."""
    answer = _ask(path, reader, head=False)
    return answer["table"], answer["header"]


def header(path: Path, reader: type[Foreign]) -> str:
    """The header of the file alone."""
    return _ask(path, reader, head=True)["header"]


def _ask(path: Path, reader: type[Foreign], head: bool) -> dict[str, Any]:
    """What the other process answers; raises InputError or OSError as its reader did, or says how it ended."""
    size = path.stat().st_size if path.is_file() else sum(p.stat().st_size for p in path.rglob("*") if p.is_file())
    seconds = SECONDS + SECONDS_PER_BYTE * size
    folder = ""
    with suppress(OSError):
        folder = os.getcwd()
    request = {
        "path": str(path),
        "folder": folder,
        "module": reader.__module__,
        "reader": reader.__name__,
        "libraries": reader.libraries(path),
        "head": head,
        "seconds": seconds,
        "wait": WAIT + 2.0 * seconds,
        "bytes": int(BYTES + BYTES_PER_BYTE * size + BYTES_PER_CORE * (os.cpu_count() or 1)),
    }
    with _LOCK:
        code, answer = _ask_server(request, path) if FORKS else _ask_new_process(request, path)
    if "errno" in answer:
        raise OSError(answer["errno"], answer["strerror"])
    if "error" in answer:
        raise InputError(answer["error"].replace("\n", r"\n"))
    if "header" not in answer:
        raise InputError(f"{path} {_sentence(code, answer, request)}")
    return answer


def _sentence(code: int, answer: dict[str, Any], request: dict[str, Any]) -> str:
    """Why a file was not read, from how its reading process ended."""
    remedy = "write it again with the program that made it"
    if answer.get("memory"):
        return (
            f"needs more than {request['bytes'] / 2**30:.0f} GiB of memory to read; it is damaged, or too large: "
            f"{remedy}, with fewer samples"
        )
    if code in (-getattr(signal, "SIGXCPU", 0), -getattr(signal, "SIGALRM", 0)):
        return f"was not read within {request['seconds']:.0f} s; it is damaged, or too large: {remedy}, in parts"
    if code == -getattr(signal, "SIGKILL", 9):
        return f"could not be read: the system ended its reader, as when memory runs out; free memory, or {remedy}"
    ending = _signal(-code) if code < 0 else answer.get("strange", f"exit status {code}")
    return f"is damaged: its reader ended on it ({ending}); {remedy}"


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


class _Server:
    """The process that forks one for each file, and the socket to it."""

    def __init__(self) -> None:
        self.socket, child_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with child_end:
            # A session of its own: Ctrl-C in the terminal is for this process, which then ends that one.
            self.process = _start("serve", "", stdin=child_end, start_new_session=True)

    def ask(self, request: dict[str, Any], file: int) -> int | None:
        """Exit code of the reading process, minus the number of a signal; None if the server itself is gone."""
        try:
            socket.send_fds(self.socket, [json.dumps(request).encode()], [file])
            reply = self.socket.recv(64)
        except ConnectionError:
            return None
        return json.loads(reply) if reply else None

    def end(self) -> None:
        """Ends the server and what it forked."""
        self.socket.close()
        with suppress(OSError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


_LOCK = Lock()
_server: _Server | None = None


def _ask_server(request: dict[str, Any], path: Path) -> tuple[int, dict[str, Any]]:
    """Exit code and answer of a process that the server forks; a server that is gone is started once more."""
    global _server
    for last in (False, True):
        _server = _server or _Server()
        with _memory() as file:
            code = None
            try:
                code = _server.ask(request, file)
            finally:  # an interrupt too leaves no process
                if code is None:
                    end()
            if code is not None or last:
                return (-9 if code is None else code), _answer(file, path)
    raise AssertionError


@contextmanager
def _memory() -> Iterator[int]:
    """A file that has no name and needs no disk."""
    file = os.memfd_create("qpal")
    try:
        yield file
    finally:
        os.close(file)


def _ask_new_process(request: dict[str, Any], path: Path) -> tuple[int, dict[str, Any]]:
    """The same by a process for this file alone, where there is no fork."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        answer = Path(folder) / "answer"
        answer.touch()
        process = _start("main", json.dumps({**request, "answer": str(answer)}), stdin=subprocess.DEVNULL)
        try:
            code = process.wait(request["wait"])
        except subprocess.TimeoutExpired:
            code = -getattr(signal, "SIGALRM", 0)
        finally:
            process.kill()
            process.wait()
        with answer.open("rb") as file:
            return code, _answer(file.fileno(), path)


def _answer(file: int, path: Path) -> dict[str, Any]:
    try:
        return read_answer(file, path)
    except (ValueError, KeyError):  # it ended before it had written all
        return {}


def _start(function: str, argument: str, **options: Any) -> subprocess.Popen:
    """A new Python process that runs a function of `_sandbox_child`."""
    folders = [folder for folder in sys.path if isinstance(folder, str)]  # the same modules as here
    code = f"import sys; sys.path[:] = {folders!r}; from sysid.formats import _sandbox_child as c; c.{function}()"
    try:
        return subprocess.Popen(
            [os.fsdecode(get_executable()), "-I", "-c", code, argument],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            # a fork would lose the threads of BLAS
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            **options,
        )
    except OSError as error:
        raise InputError(
            f"no process could be started to read the file in ({error.strerror}); end other programs and try again"
        ) from None


def end() -> None:
    """Ends the server, if there is one; the next file starts another."""
    global _server
    server, _server = _server, None
    if server:
        server.end()


def _forget() -> None:
    """In a process that was forked from this one: the server is not its own."""
    global _server, _LOCK
    if _server:
        _server.socket.close()
        _server.process.returncode = 0
    _server, _LOCK = None, Lock()


atexit.register(end)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
