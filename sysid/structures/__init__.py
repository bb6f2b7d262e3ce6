"""Named recipes of chains: one file, one function, one line in `TABLE`."""

import inspect
from collections.abc import Callable

from sysid.chain import Chain
from sysid.errors import InputError, unknown
from sysid.structures.hammerstein import hammerstein
from sysid.structures.hammerstein_wiener import hammerstein_wiener
from sysid.structures.output_error import output_error
from sysid.structures.wiener import wiener
from sysid.structures.wiener_hammerstein import wiener_hammerstein

TABLE: dict[str, Callable[..., Chain]] = {
    "hammerstein": hammerstein,
    "hammerstein_wiener": hammerstein_wiener,
    "output_error": output_error,
    "wiener": wiener,
    "wiener_hammerstein": wiener_hammerstein,
}


def build(name: str, nb: int, nf: int, nk: int, input: str | None = None, output: str | None = None) -> Chain:
    """The structure called `name`; a map that the structure has no place for is an InputError."""
    if name not in TABLE:
        raise unknown("structure", name, TABLE)
    accepted = inspect.signature(TABLE[name]).parameters
    given = {k: v for k, v in (("input", input), ("output", output)) if v is not None}
    for k, v in given.items():
        if k not in accepted:
            raise InputError(f"structure {name} has no {k} map, got {v!r}; leave it out or choose hammerstein_wiener")
    return TABLE[name](nb, nf, nk, **given)


__all__ = ["TABLE", "build", "hammerstein", "hammerstein_wiener", "output_error", "wiener", "wiener_hammerstein"]
