"""A journal of finished work, one JSON line each, so that a stopped search can continue."""

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import CHECK, DAMAGED, UNSEALED, Lines, atomic_file, check_regular_file, seal, unseal
from sysid.base.locks import file_lock
from sysid.data.record import IOData

VERSIONS = (1, 2)  # of the file; rows of 1 have no check sum


class Journal:
    """Results by round and key in a file, or only in memory if no path is given.

    The first line identifies the record and settings of the results. Each result is appended in one write and flushed;
    an incomplete last line is ignored. A row has a check sum over its content and the first line: `notes` tells of rows
    that do not hold, of rows of older versions without one, and of candidates that are there twice with other values.
    They leave the file, and their candidates are run again.
    """

    def __init__(self, path: str | Path | None, data: IOData, settings: Any) -> None:
        self._lines = None if path is None else Lines(Path(path))
        self._known: dict[str, dict[str, Any]] = {}
        self.notes: tuple[str, ...] = ()
        digest = hashlib.sha256(np.ascontiguousarray(data.u).tobytes() + np.ascontiguousarray(data.y).tobytes())
        digest.update(repr((data.Ts, data.lengths, settings)).encode())
        self._of = digest.hexdigest()
        if self._lines is None:
            return
        if self._begun(self._lines.path):
            self._read(self._lines)
        else:
            self._append(self._head())

    def find(self, number: int, key: dict[str, Any]) -> dict[str, Any] | None:
        """The result for this key in this round, or None."""
        return self._known.get(_name(number, key))

    def add(self, number: int, key: dict[str, Any], values: dict[str, Any]) -> None:
        """Keep a result."""
        self._known[_name(number, key)] = values
        if self._lines is not None:
            self._append(self._row(_name(number, key), values))

    def _begun(self, path: Path) -> bool:
        """Whether there is more than a part of the first line, which a kill may leave."""
        try:
            with path.open("rb") as file:
                beginning = file.read(1000)
        except FileNotFoundError:
            return False
        except OSError:
            return True  # which reading it tells
        return not json.dumps(self._head()).encode().startswith(beginning)

    def _head(self) -> dict[str, Any]:
        return {"journal": VERSIONS[-1], "of": self._of}

    def _row(self, name: str, values: dict[str, Any]) -> dict[str, Any]:
        return seal({"key": name, "values": values}, self._of)

    def _append(self, row: dict[str, Any]) -> None:
        assert self._lines is not None
        try:
            self._lines.append(json.dumps(row))
        except OSError as error:
            raise self._unwritable(self._lines, error) from None

    def _read(self, lines: Lines) -> None:
        try:
            lines_read = lines.read()
            first = json.loads(lines_read[0])
        except (OSError, ValueError, IndexError, RecursionError):
            raise InputError(f"{lines.path} is not a journal of a search; give a path that does not exist") from None
        if first not in [{"journal": version, "of": self._of} for version in VERSIONS]:
            raise InputError(
                f"the journal {lines.path} belongs to another record, space, search or seed; "
                "give another path or remove it"
            )
        sums: dict[str, str] = {}
        double: set[str] = set()
        bad = {DAMAGED: 0, UNSEALED: 0}
        for line in lines_read[1:]:
            if line == lines_read[0]:  # the head of a copy that was joined to it
                continue
            row, trouble = unseal(line, self._of)
            if trouble:
                bad[trouble] += 1
                continue
            name, check_sum = row["key"], json.loads(line)[CHECK]
            if sums.setdefault(name, check_sum) != check_sum:
                double.add(name)
            self._known[name] = row["values"]
        for name in double:
            del self._known[name]
        self.notes = tuple(_damage_notes(lines.path, bad[DAMAGED], bad[UNSEALED], len(double)))
        if self.notes:
            self._rewrite(lines)

    def _rewrite(self, lines: Lines) -> None:
        """The file with the rows that hold alone."""
        rows = [self._head(), *(self._row(name, values) for name, values in self._known.items())]
        try:
            with atomic_file(lines.path) as temporary:
                temporary.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
        except OSError as error:
            raise self._unwritable(lines, error) from None

    @staticmethod
    def _unwritable(lines: Lines, error: OSError) -> InputError:
        return InputError(f"cannot write the journal {lines.path}: {error.strerror}; give another path")


@contextmanager
def writing(path: str | Path | None, data: IOData, settings: Any) -> Iterator[Journal]:
    """The journal, which no other search can use meanwhile."""

    def taken(who: str) -> str:
        return f"another search ({who}) writes to the journal {path}; wait until it ends, or give another path"

    with nullcontext() if path is None else file_lock(check_regular_file(path), taken):
        yield Journal(path, data, settings)


def _damage_notes(path: Path, damaged: int, unsealed: int, double: int) -> list[str]:
    sentences = []
    if damaged:
        rows, subject = ("row", "its candidate is") if damaged == 1 else ("rows", "their candidates are")
        sentences.append(
            f"{damaged} {rows} of the journal {path} changed since the search wrote them; {subject} run again"
        )
    if unsealed:
        rows, subject = ("row", "its candidate is") if unsealed == 1 else ("rows", "their candidates are")
        have = "has" if unsealed == 1 else "have"
        sentences.append(
            f"{unsealed} {rows} of the journal {path} {have} no check sum (an older version); {subject} run again"
        )
    if double:
        subject = "a candidate, which is" if double == 1 else f"{double} candidates, which are"
        sentences.append(f"the journal {path} has two different results of {subject} run again")
    return sentences


def _name(number: int, key: dict[str, Any]) -> str:
    return json.dumps([number, key], sort_keys=True)
