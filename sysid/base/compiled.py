"""The one way to compiled loops: numba, with its cache on disk where there is one that can be trusted.

A cache saves seconds and never decides anything. Without a folder for it the loop is compiled in each process; a file
of it that is cut, changed or of another version is compiled anew and written again. A loop that another process is
compiling is awaited, where the system has locks.
"""

import hashlib
import pickle
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import get_ident
from typing import Any, ClassVar

from numba import njit
from numba.core import caching, event, sigutils
from numba.core.ccallback import CFunc

from sysid.base.errors import InputError
from sysid.base.locks import Lock, take_lock

PATIENCE = 60.0  # [s] for another process, which may be stopped; the longest loop compiles in 10 s
_GLANCES = 0.02  # [s] between two looks whether it is done
_DIGEST = 32  # bytes


class _Files(caching.IndexDataCacheFile):
    """Numba's files behind a checksum: changed machine code would crash the process or give other numbers."""

    def _dump(self, obj: Any) -> bytes:
        raw = super()._dump(obj)
        return hashlib.sha256(raw).digest() + raw

    def _load_index(self) -> dict:
        return self._read_checked(self._index_path) or {}

    def _save_index(self, overloads: dict) -> None:
        with self._open_for_write(self._index_path) as file:
            file.write(self._dump((self._version, self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        return self._read_checked(self._data_path(name))

    def _read_checked(self, path: str) -> Any:
        """What was stored at `path`; None if it is missing, damaged or of another version of numba or the source."""
        try:
            with open(path, "rb") as file:
                raw = file.read()
        except OSError:
            return None
        if hashlib.sha256(raw[_DIGEST:]).digest() != raw[:_DIGEST]:
            return None
        content = pickle.loads(raw[_DIGEST:])  # our own bytes: the checksum holds
        if path != self._index_path:
            return content
        version, stamp, overloads = content
        return overloads if (version, stamp) == (self._version, self._source_stamp) else None


class _BusyError(Exception):
    """Another process is compiling the loop."""


def _busy(holder: str) -> str:
    raise _BusyError(holder)


class _Cache(caching.FunctionCache):
    """Numba's cache of a function, which never ends the program."""

    waits: ClassVar[bool] = True  # for another process that is compiling the same loop; else it is left to that one

    def __init__(self, function: Callable) -> None:
        super().__init__(function)
        self._cache_file = _Files(
            cache_path=self._cache_path,
            filename_base=f"{self._impl.filename_base}.whole",  # numba's own files have no checksum
            source_stamp=self._impl.locator.get_source_stamp(),
        )
        self._lock: Lock | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = self._load(sig, target_context)
        if found is None and self._lock is None and not refuses():
            self._lock = self._taken()
            found = self._load(sig, target_context)  # another process may have written it meanwhile
            if found is not None:
                self.release()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(Exception):  # a full disk, a folder that has gone
            super().save_overload(sig, data)
        self.release()

    def release(self) -> None:
        """Another process may compile the loop."""
        lock, self._lock = self._lock, None
        if lock is not None:
            lock.close()

    def _load(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # each layer below pickle fails in its own way; to compile is always right
            return None

    def _taken(self) -> Lock | None:
        """The lock of who compiles the loop; None where there is none, or another process has it for too long."""
        path, end = Path(f"{self._cache_file._index_path}.lock"), time.monotonic() + PATIENCE
        _compilations.running += 1
        try:
            while time.monotonic() < end:
                with suppress(_BusyError):
                    return take_lock(path, _busy)
                if not self.waits:
                    raise CompilationRefusedError("another process is compiling the loop")
                time.sleep(_GLANCES)
        except (InputError, OSError):  # a lock that cannot be made or opened
            pass
        finally:
            _compilations.running -= 1
        return None


def leave_to_others() -> None:
    """From now on a loop that another process is compiling is refused by a `CompilationRefusedError`, not awaited."""
    _Cache.waits = False


def is_kept(made: Any) -> bool:
    """Whether a kernel has a place on the disk."""
    return isinstance(getattr(made, "_cache", None), _Cache)


def _with_cache(made: Any, function: Callable) -> Any:
    """A dispatcher or callback with its cache; without one where no folder can be written to."""
    with suppress(RuntimeError, OSError):  # numba finds no place for a cache
        made._cache = _Cache(function)
    return made


class CompilationRefusedError(Exception):
    """A loop that is on no disk yet was to be compiled where there is no time for that, or another process does it."""


class _Compilations(event.Listener):
    """Counts what numba is compiling at the moment."""

    running = 0
    refusing: ClassVar[dict[int, list[str]]] = {}  # by thread, what was refused in it

    def on_start(self, event: Any) -> None:
        self.running += 1  # its end comes also where this raises
        refused = self.refusing.get(get_ident())
        if refused is not None:
            refused.append(str(event.data["dispatcher"]))
            raise CompilationRefusedError("a loop would be compiled")

    def on_end(self, event: Any) -> None:
        self.running -= 1
        if sys.exc_info()[0] is not None and is_kept(event.data["dispatcher"]):  # nothing will be saved
            event.data["dispatcher"]._cache.release()


_compilations = _Compilations()
event.register("numba:compile", _compilations)


@contextmanager
def refusing_compilation() -> Iterator[list[str]]:
    """What would be compiled in this thread is refused with a `CompilationRefusedError`, and named in the list.

    The list tells also of what a caller within has caught.
    """
    refused: list[str] = []
    _Compilations.refusing[get_ident()] = refused
    try:
        yield refused
    finally:
        del _Compilations.refusing[get_ident()]


def refuses() -> bool:
    """Whether this thread refuses what would be compiled."""
    return get_ident() in _Compilations.refusing


def compiles() -> bool:
    """Whether a loop is being compiled now, in any thread: seconds, once on a machine."""
    return _compilations.running > 0


def kernel(function: Callable | None = None, **options: Any) -> Any:
    """Decorator: a compiled function that releases the GIL; `options` are those of `numba.njit`."""
    if function is None:
        return lambda given: kernel(given, **options)
    compiled = njit(nogil=True, **options)(function)
    return (
        compiled if compiled is function else _with_cache(compiled, function)
    )  # NUMBA_DISABLE_JIT gives the function itself


def callback(signature: Any, **options: Any) -> Callable[[Callable], Any]:
    """Decorator: a compiled C callback of a numba signature; `options` are those of `numba.cfunc`."""

    def made(function: Callable) -> Any:
        compiled = _with_cache(
            CFunc(function, sigutils.normalize_signature(signature), locals={}, options=options), function
        )
        compiled.compile()
        return compiled

    return made
