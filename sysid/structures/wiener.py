"""Wiener: B/F, then static map."""

from collections.abc import Sequence
from typing import Any

from sysid.model.chain import Chain
from sysid.model.recipes import Map, Order, filters, maps


def wiener(
    nb: Order = 2,
    nf: Order = 3,
    nk: Order = 1,
    output: Map | Sequence[Map] = "piecewise_linear",
    nu: int = 1,
    ny: int = 1,
    **limits: Any,
) -> Chain:
    """y = h(B/F u): linear dynamics before a sensor's map; one map for each output.

    `limits` are the chain's `fixed` and `bounds`, by parameter.
    """
    return Chain((filters(nb, nf, nk, nu, ny), maps(output, "output", ny)), structure="wiener", **limits)
