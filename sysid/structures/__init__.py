"""Named recipes of models: one file, one function, one line in `TABLE`; `CHAINS` are those that make a chain."""

import inspect
from collections.abc import Callable
from typing import Any

from sysid.base.errors import InputError, unknown
from sysid.model.chain import Chain
from sysid.structures.actuated_joint import actuated_joint
from sysid.structures.hammerstein import hammerstein
from sysid.structures.hammerstein_wiener import hammerstein_wiener
from sysid.structures.nlarx import nlarx
from sysid.structures.output_error import output_error
from sysid.structures.wiener import wiener
from sysid.structures.wiener_hammerstein import wiener_hammerstein

CHAINS: dict[str, Callable[..., Chain]] = {
    "hammerstein": hammerstein,
    "hammerstein_wiener": hammerstein_wiener,
    "output_error": output_error,
    "wiener": wiener,
    "wiener_hammerstein": wiener_hammerstein,
}
TABLE: dict[str, Callable[..., Any]] = {**CHAINS, "actuated_joint": actuated_joint, "nlarx": nlarx}


def build(name: str, nb: int, nf: int, nk: int, input: str | None = None, output: str | None = None) -> Any:
    """The structure called `name`: a Chain, or an Nlarx with na = nf. A map it has no place for is an InputError.

    An actuated joint has no orders, and `input` and `output` are its driver and its sensor; it is the plain one that
    `sysid.joint.growth` begins with.
    """
    if name not in TABLE:
        raise unknown("structure", name, TABLE)
    if name == "actuated_joint":
        return actuated_joint(driver=input, sensor=output, play=False)
    accepted = inspect.signature(TABLE[name]).parameters
    given = {k: v for k, v in (("input", input), ("output", output)) if v is not None}
    for k, v in given.items():
        if k not in accepted:
            raise InputError(f"structure {name} has no {k} map, got {v!r}; leave it out or choose hammerstein_wiener")
    if name not in CHAINS:
        return TABLE[name](na=nf, nb=nb, nk=nk, **given)
    return TABLE[name](nb, nf, nk, **given)


__all__ = [
    "CHAINS",
    "TABLE",
    "actuated_joint",
    "build",
    "hammerstein",
    "hammerstein_wiener",
    "nlarx",
    "output_error",
    "wiener",
    "wiener_hammerstein",
]
