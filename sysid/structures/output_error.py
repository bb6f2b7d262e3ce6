"""Output error: B/F alone."""

from typing import Any

from sysid.model.chain import Chain
from sysid.model.recipes import Order, filters


def output_error(nb: Order = 2, nf: Order = 3, nk: Order = 1, nu: int = 1, ny: int = 1, **limits: Any) -> Chain:
    """y = B/F u with white noise at the output. It has no offset: take the means off first.

    `limits` are the chain's `fixed` and `bounds`, by parameter.
    """
    return Chain((filters(nb, nf, nk, nu, ny),), structure="output_error", **limits)
