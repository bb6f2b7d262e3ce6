"""What can be taken back: the last changes of a session, each with what undoes it."""

from collections.abc import Callable
from typing import Any

from sysid.base.errors import InputError

KEPT = 50  # changes


class History:
    """The changes that can be undone, the last one first; it lasts as long as the app."""

    def __init__(self) -> None:
        self._changes: list[tuple[str, Callable[[], Any]]] = []
        self._undoing = False

    def add(self, words: str, undo: Callable[[], Any]) -> None:
        """A change in a few words, and what undoes it; what an undo changes is none."""
        if not self._undoing:
            self._changes = [*self._changes, (words, undo)][-KEPT:]

    @property
    def last(self) -> str:
        """What would be undone next, in words; empty if nothing."""
        return self._changes[-1][0] if self._changes else ""

    def undo(self) -> str:
        """Undo the last change, which is returned in words; raises InputError if there is none."""
        if not self._changes:
            raise InputError("there is nothing to undo")
        words, undo = self._changes.pop()
        self._undoing = True
        try:
            undo()
        finally:
            self._undoing = False
        return words
