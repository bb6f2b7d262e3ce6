"""Hammerstein-Wiener: static map, B/F, static map."""

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
def hammerstein_wiener(
    nb: Order = 2,
    nf: Order = 3,
    nk: Order = 1,
    input: Map | Sequence[Map] = "piecewise_linear",
    output: Map | Sequence[Map] = "piecewise_linear",
    nu: int = 1,
    ny: int = 1,
    offset: str = "none",
    **limits: Any,
) -> Chain:
    """y = h(B/F f(u)), equations (3) to (5) of Guni and Irawan 2016, with the toolbox's defaults.

    It cannot model an end stop of an integrating plant, because its state is linear. `offset` is
    "free" for an offset of each output where no map holds it, "each" for one of every experiment, else "none".
    `limits` are the `fixed` and `bounds` of the chain, by parameter.
    """
    blocks = (maps(input, "input", nu), filters(nb, nf, nk, nu, ny), maps(output, "output", ny))
    return Chain(with_offset(blocks, ny, offset), structure="hammerstein_wiener", **limits)


@checked
@dataclass(frozen=True)
class HammersteinWiener(Several, LinearOrders):
    """Settings of `hammerstein_wiener`."""

    name: ClassVar[str] = "hammerstein_wiener"
    searched: ClassVar[bool] = True
    input_map: str | None = static_map("input map", "static map before the linear block")
    output_map: str | None = static_map("output map", "static map after the linear block")
    offset: str = zero_of_output()

    def model(self, nu: int = 1, ny: int = 1) -> Chain:
        chosen = named(input=self.input_map, output=self.output_map)
        return hammerstein_wiener(self.nb, self.nf, self.nk, nu=nu, ny=ny, offset=self.offset, **chosen)
