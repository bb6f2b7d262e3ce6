"""What ends with its context: a line, a port, a board."""

from types import TracebackType
from typing import Self


class Closing:
    """A context manager that calls `close` at its end, however it ends."""

    def close(self) -> None:
        """End it, and free what it holds."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
