"""The error that bad input raises: a sentence that says what was found, what was allowed and what to do."""

from collections.abc import Iterable


class InputError(ValueError):
    """Bad input; its text is one sentence for the user. The command line prints it and exits with 2."""


def unknown(what: str, got: str, allowed: Iterable[str]) -> InputError:
    """The error for a name that is not in a table: unknown joint 'knee'; choose one of shoulder, thigh, shank."""
    return InputError(f"unknown {what} {got!r}; choose one of {', '.join(allowed)}")
