"""Hammerstein: static map, then B/F."""

from collections.abc import Sequence
from typing import Any

from sysid.model.chain import Chain
from sysid.model.recipes import Map, Order, filters, maps


def hammerstein(
    nb: Order = 2,
    nf: Order = 3,
    nk: Order = 1,
    input: Map | Sequence[Map] = "piecewise_linear",
    nu: int = 1,
    ny: int = 1,
    **limits: Any,
) -> Chain:
    """y = B/F f(u): an actuator's map before linear dynamics; one map for each input.

    `limits` are the chain's `fixed` and `bounds`, by parameter.
    """
    return Chain((maps(input, "input", nu), filters(nb, nf, nk, nu, ny)), structure="hammerstein", **limits)
