"""A journal of finished work, one JSON line each, so that a stopped search can continue."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import Lines
from sysid.data.record import IOData


class Journal:
    """Results by round and key in a file, or only in memory if no path is given.

    The first line identifies the record and settings of the results. Each result is appended in one write and flushed;
    an incomplete last line is ignored.
    """

    def __init__(self, path: str | Path | None, data: IOData, settings: Any) -> None:
        self._lines = None if path is None else Lines(Path(path))
        self._known: dict[str, dict[str, Any]] = {}
        digest = hashlib.sha256(np.ascontiguousarray(data.u).tobytes() + np.ascontiguousarray(data.y).tobytes())
        digest.update(repr((data.Ts, data.lengths, settings)).encode())
        head = {"journal": 1, "of": digest.hexdigest()}
        if self._lines is None:
            return
        if self._lines.path.exists() and self._lines.path.stat().st_size:
            self._read(self._lines, head)
        else:
            self._append(head)

    def find(self, number: int, key: dict[str, Any]) -> dict[str, Any] | None:
        """The result for this key in this round, or None."""
        return self._known.get(_name(number, key))

    def add(self, number: int, key: dict[str, Any], values: dict[str, Any]) -> None:
        """Keep a result."""
        self._known[_name(number, key)] = values
        if self._lines is not None:
            self._append({"key": _name(number, key), "values": values})

    def _append(self, row: dict[str, Any]) -> None:
        assert self._lines is not None
        try:
            self._lines.append(json.dumps(row))
        except OSError as error:
            raise InputError(
                f"cannot write the journal {self._lines.path}: {error.strerror}; give another path"
            ) from None

    def _read(self, lines: Lines, head: dict[str, Any]) -> None:
        try:
            found = lines.read()
            first = json.loads(found[0])
        except (OSError, UnicodeDecodeError, ValueError, IndexError):
            raise InputError(f"{lines.path} is not a journal of a search; give a path that does not exist") from None
        if first != head:
            raise InputError(
                f"the journal {lines.path} belongs to another record, space, search or seed; "
                "give another path or remove it"
            )
        for line in found[1:]:
            try:
                row = json.loads(line)
                self._known[row["key"]] = row["values"]
            except (ValueError, KeyError, TypeError):
                continue  # damaged: that candidate is done again


def _name(number: int, key: dict[str, Any]) -> str:
    return json.dumps([number, key], sort_keys=True)
