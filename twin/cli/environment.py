"""The process that a verb finds: limits, variables that libraries die of, and standard streams of every kind."""

import codecs
import logging
import os
import re
import sys
import threading
import unicodedata
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

LEAST = 2048  # [MiB] of address space; below it a library's own threads cannot start, and it aborts or waits for ever
THREADS = 8  # that a small machine's libraries start
EPOCH = "SOURCE_DATE_EPOCH"  # NumPy takes it for a number while it loads
# MuJoCo reads it while it loads, and without it loads GLFW, which starts a process to look at its library, and that one
# tells a traceback where the verb is killed meanwhile. What draws the robot is another process, with its own value.
ALWAYS = {"MUJOCO_GL": "disable"}
# For who tests a library: no result may die of a warning, in a worker neither.
CHANGED = {"PYTHONWARNINGS": "default"}
# The libraries end in an error or abort where these are anything else; a verb then runs without them.
COUNT, SWITCH = r"[1-9]\d{0,2}", r"[01]"
UNDERSTOOD = {
    EPOCH: r"\d{1,12}",
    "NUMBA_NUM_THREADS": COUNT,
    "POLARS_MAX_THREADS": COUNT,
    "LOKY_MAX_CPU_COUNT": COUNT,
    "LOKY_MAX_DEPTH": COUNT,
    "JOBLIB_MULTIPROCESSING": SWITCH,
    "JOBLIB_START_METHOD": "fork|forkserver|spawn",
    "NUMBA_CPU_FEATURES": r"([+-][\w.-]+(,[+-][\w.-]+)*)?",
    "NUMBA_OPT": "[0-3]|max",
}
_QUIET = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)  # as Python itself has it


@contextmanager
def within_reason() -> Iterator[None]:
    """A verb runs within it; variables and filters of warnings are as before when it ends."""
    former = {name: os.environ[name] for name in (*ALWAYS, *CHANGED) if name in os.environ}
    os.environ.update(ALWAYS | {name: value for name, value in CHANGED.items() if name in former})
    for name, pattern in UNDERSTOOD.items():
        if not re.fullmatch(pattern, os.environ.get(name, ""), re.ASCII) and name in os.environ:
            former[name] = os.environ.pop(name)
    # Where a disk is full or the home cannot be written to it says so in its own words, and does without its cache.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            if any(option.partition(":")[0].startswith("e") for option in sys.warnoptions):
                warnings.simplefilter("default")
                for category in _QUIET:
                    warnings.simplefilter("ignore", category)
            yield
    finally:
        for name in ALWAYS:
            os.environ.pop(name, None)
        os.environ.update(former)


def no_room() -> str:
    """A sentence where this process may not have the address space that the libraries reserve; else nothing."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return ""
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft == resource.RLIM_INFINITY or soft >= LEAST << 20:
        return ""
    return (
        f"this process may have {soft >> 20} MiB of address space and needs {LEAST} MiB, most of which stays unused; "
        f"give it more with: ulimit -v {LEAST << 10}"
    )


def no_threads() -> str:
    """A sentence where this process may not start the threads that the libraries start; else nothing.

    OpenBLAS would say so in lines of its own and then interrupt the process, as if a person had.
    """
    stop = threading.Event()
    threads = []
    try:
        for _ in range(THREADS):
            threads.append(threading.Thread(target=stop.wait, daemon=True))
            threads[-1].start()
    except RuntimeError:
        return (
            f"this process may start {len(threads) - 1} threads and needs {THREADS}; end other programs of this user, "
            "or raise the limit of processes, see ulimit -u"
        )
    finally:
        stop.set()
        for thread in threads:
            if thread.ident is not None:
                thread.join()
    return ""


LETTERS = {
    "−": "-", "–": "-", "—": "-", "×": "x", "·": ".", "•": "*", "°": "deg", "µ": "u", "±": "+/-", "≤": "<=", "≥": ">=",
    "≈": "~", "∞": "inf", "√": "sqrt", "→": "->", "←": "<-", "“": '"', "”": '"', "‘": "'", "’": "'", "…": "...",
}  # fmt: skip
BOX = {"HORIZONTAL": "-", "VERTICAL": "|"}
PLAIN = "qpal-plain"  # the name of `_encode_plainly` among Python's ways to treat what an encoding lacks


@contextmanager
def streams() -> Iterator[None]:
    """Within it every stream can be written to, with any text.

    A closed one leads nowhere: its number would otherwise go to the next file that opens, and prints into that file.
    Text that the encoding of a stream lacks is replaced by plain letters, and what acts on a terminal is escaped.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            _replace_closed(number, name)
    codecs.register_error(PLAIN, _encode_plainly)
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, ValueError, OSError):  # it is none of Python's own, or cannot be changed
            stream.reconfigure(errors=PLAIN)  # type: ignore[union-attr]
    former = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = Readable(sys.stdout), Readable(sys.stderr)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = former


class Readable:
    """A stream to which everything is written as `sysid.base.errors.readable` has it: names of files and columns, words
    of others. A table in colour and a bar are written to the `stream` itself, with their texts made readable before.
    """

    def __init__(self, stream: Any) -> None:
        self.stream = raw(stream)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Write what is readable of it."""
        from sysid.base.errors import readable

        return int(self.stream.write(readable(text)))

    def writelines(self, texts: Iterable[str]) -> None:
        """Write each."""
        for text in texts:
            self.write(text)


def raw(stream: Any) -> Any:
    """The stream itself, for data and for what has been made readable before."""
    return stream.stream if isinstance(stream, Readable) else stream


def say(sentence: str) -> None:
    """A line on standard error, if anybody can hear it."""
    try:
        print(sentence, file=sys.stderr, flush=True)
    except (OSError, ValueError):
        drop("stderr")


def flush() -> None:
    """Standard output is out; a reader that went away is no error. Raises OSError if it cannot be written to."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        drop()


def drop(name: str = "stdout") -> None:
    """A stream leads nowhere from here on: what still waits in it must not fail again while Python ends."""
    with suppress(OSError, ValueError, AttributeError):
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, getattr(sys, name).fileno())
        os.close(sink)


def plain(text: str) -> str:
    """A text in ASCII: rules of tables, Greek letters and signs by what they look like or are called."""
    return "".join(c if c.isascii() else _letters(c) for c in text)


def _letters(c: str) -> str:
    """ASCII for one letter: from the table, or from its name and decomposition in Unicode."""
    if c in LETTERS:
        return LETTERS[c]
    kind, *words = unicodedata.name(c, "NONE").split()
    if kind == "BOX":
        return next((sign for word, sign in BOX.items() if words[-1] == word and "AND" not in words), "+")
    if kind == "GREEK" and words[1:2] == ["LETTER"]:
        return words[2].title() if words[0] == "CAPITAL" else words[2].lower()
    parts = unicodedata.decomposition(c)
    simple = "".join(LETTERS.get(d, d) for d in unicodedata.normalize("NFKD", c)).encode("ascii", "ignore").decode()
    if parts.startswith("<super>"):
        return "^" + simple
    return simple or c.encode("ascii", "backslashreplace").decode()


def _encode_plainly(error: UnicodeError) -> tuple[str, int]:
    """What stands for letters that a stream lacks."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return plain(error.object[error.start]), error.start + 1


def _replace_closed(number: int, name: str) -> None:
    try:
        os.fstat(number)
    except OSError:
        sink = os.open(os.devnull, os.O_RDWR)
        if sink != number:
            os.dup2(sink, number)
            os.close(sink)
    mode: Any = "r" if number == 0 else "w"
    setattr(sys, name, open(os.devnull, mode, encoding="utf-8", errors="replace"))  # noqa: SIM115
