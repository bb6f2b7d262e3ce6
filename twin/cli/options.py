"""Options that verbs share, and the ones whose text has to be taken apart."""

from collections.abc import Iterable
from typing import Annotated, Any

import typer

from sysid.errors import InputError

Out = Annotated[
    str | None, typer.Option("--out", metavar="DIR", help="where to write; runs/<stamp>-<verb> if not given")
]
Json = Annotated[bool, typer.Option("--json", help="print the summary alone, as JSON")]


def number(metavar: str, help: str) -> Any:
    """An option that takes a number."""
    return typer.Option(parser=_number, metavar=metavar, help=help)


def whole(metavar: str, help: str) -> Any:
    """An option that takes a whole number."""
    return typer.Option(parser=_whole, metavar=metavar, help=help)


def name(help: str, allowed: Iterable[str]) -> Any:
    """An option that takes a name of a table; whether it is one is for the table's owner to say."""
    return typer.Option(metavar="NAME", help=f"{help}: {', '.join(allowed)}")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"found {text!r}, give a number") from None


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise typer.BadParameter(f"found {text!r}, give a whole number") from None


def orders(text: str) -> tuple[int, int, int]:
    """nb, nf, nk out of '2,3,1'."""
    parts = [part.strip() for part in text.split(",")]
    allowed = "give three whole numbers nb,nf,nk, for example 2,3,1"
    if len(parts) != 3:
        raise InputError(f"--orders is {text!r} with {len(parts)} part(s); {allowed}")
    try:
        nb, nf, nk = (int(part) for part in parts)
    except ValueError:
        raise InputError(f"--orders is {text!r}, which are not all whole numbers; {allowed}") from None
    for name, value, least in (("nb", nb, 1), ("nf", nf, 0), ("nk", nk, 0)):
        if not least <= value <= 100:
            raise InputError(f"--orders is {text!r} with {name} {value}; give {name} from {least} to 100")
    return nb, nf, nk


def names(text: str) -> tuple[str, ...]:
    """Names out of 'a,b'; none out of an empty text."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def seed(value: int) -> int:
    """A seed that NumPy takes."""
    if value < 0:
        raise InputError(f"--seed is {value}; give a whole number from 0 on")
    return value
