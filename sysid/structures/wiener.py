"""Wiener: B/F, then static map."""

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
def wiener(
    nb: Order = 2,
    nf: Order = 3,
    nk: Order = 1,
    output: Map | Sequence[Map] = "piecewise_linear",
    nu: int = 1,
    ny: int = 1,
    offset: str = "none",
    **limits: Any,
) -> Chain:
    """y = h(B/F u): linear dynamics before a static map, for example of a sensor; one map for each output.

    `offset` is "free" for an offset of each output where no map holds it, "each" for one of every experiment, else
    "none": then take the means off the record first. `limits` are the `fixed` and `bounds` of the chain, by parameter.
    """
    blocks = (filters(nb, nf, nk, nu, ny), maps(output, "output", ny))
    return Chain(with_offset(blocks, ny, offset), structure="wiener", **limits)


@checked
@dataclass(frozen=True)
class Wiener(Several, LinearOrders):
    """Settings of `wiener`."""

    name: ClassVar[str] = "wiener"
    searched: ClassVar[bool] = True
    output_map: str | None = static_map("output map", "static map after the linear block")
    offset: str = zero_of_output()

    def model(self, nu: int = 1, ny: int = 1) -> Chain:
        return wiener(self.nb, self.nf, self.nk, nu=nu, ny=ny, offset=self.offset, **named(output=self.output_map))
