"""The error that bad input raises: a sentence that says what was found, what was allowed and what to do."""

from collections.abc import Iterable


class InputError(ValueError):
    """Bad input; its text is one sentence for the user. The command line prints it and exits with 2."""

    def __init__(self, *said: object) -> None:
        """Bytes of a file name that are no text are written as \\udc80, since no terminal or report takes them."""
        super().__init__(*(s.encode(errors="backslashreplace").decode() if isinstance(s, str) else s for s in said))


def unknown(what: str, got: str, allowed: Iterable[str]) -> InputError:
    """The error for a name that is not in a table: unknown joint 'knee'; choose one of shoulder, thigh, shank."""
    return InputError(f"unknown {what} {got!r}; choose one of {', '.join(allowed)}")
