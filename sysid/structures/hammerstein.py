"""Hammerstein: static map, then B/F."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.model.chain import Chain
from sysid.model.recipes import LinearOrders, Map, Order, Several, filters, maps, named, static_map


@checked
def hammerstein(
    nb: Order = 2,
    nf: Order = 3,
    nk: Order = 1,
    input: Map | Sequence[Map] = "piecewise_linear",
    nu: int = 1,
    ny: int = 1,
    **limits: Any,
) -> Chain:
    """y = B/F f(u): a static map, for example of an actuator, before linear dynamics; one map for each input.

    `limits` are the `fixed` and `bounds` of the chain, by parameter.
    """
    return Chain((maps(input, "input", nu), filters(nb, nf, nk, nu, ny)), structure="hammerstein", **limits)


@checked
@dataclass(frozen=True)
class Hammerstein(Several, LinearOrders):
    """Settings of `hammerstein`."""

    name: ClassVar[str] = "hammerstein"
    searched: ClassVar[bool] = True
    input_map: str | None = static_map("input map", "static map before the linear block")

    def model(self, nu: int = 1, ny: int = 1) -> Chain:
        return hammerstein(self.nb, self.nf, self.nk, nu=nu, ny=ny, **named(input=self.input_map))
