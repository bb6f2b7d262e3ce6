"""Hammerstein: static map, then B/F."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.model.chain import Chain
from sysid.model.recipes import (
    LinearOrders,
    Map,
    Order,
    Several,
    filters,
    maps,
    named,
    static_map,
    with_offset,
    zero_of_output,
)


@checked
def hammerstein(
    nb: Order = 2,
    nf: Order = 3,
    nk: Order = 1,
    input: Map | Sequence[Map] = "piecewise_linear",
    nu: int = 1,
    ny: int = 1,
    offset: str = "none",
    **limits: Any,
) -> Chain:
    """y = B/F f(u): a static map, for example of an actuator, before linear dynamics; one map for each input.

    `offset` is "free" for an offset of each output where no map holds it, "each" for one of every experiment, else
    "none": then take the means off the record first. `limits` are the `fixed` and `bounds` of the chain, by parameter.
    """
    blocks = (maps(input, "input", nu), filters(nb, nf, nk, nu, ny))
    return Chain(with_offset(blocks, ny, offset), structure="hammerstein", **limits)


@checked
@dataclass(frozen=True)
class Hammerstein(Several, LinearOrders):
    """Settings of `hammerstein`."""

    name: ClassVar[str] = "hammerstein"
    searched: ClassVar[bool] = True
    input_map: str | None = static_map("input map", "static map before the linear block")
    offset: str = zero_of_output()

    def model(self, nu: int = 1, ny: int = 1) -> Chain:
        return hammerstein(self.nb, self.nf, self.nk, nu=nu, ny=ny, offset=self.offset, **named(input=self.input_map))
