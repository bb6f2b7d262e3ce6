"""Wiener-Hammerstein: B/F, static map, B/F."""

from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.block.block import StaticBlock
from sysid.blocks import TransferFunction, static
from sysid.model.chain import Chain
from sysid.model.recipes import LinearOrders


@checked
def wiener_hammerstein(
    nb: int = 2,
    nf: int = 3,
    nk: int = 1,
    nb2: int | None = None,
    nf2: int | None = None,
    nk2: int = 0,
    middle: str | StaticBlock = "piecewise_linear",
    **limits: Any,
) -> Chain:
    """y = B2/F2 g(B1/F1 u); by default the second filter has the orders of the first and no delay.

    `limits` are the `fixed` and `bounds` of the chain, by parameter.
    """
    second = TransferFunction(nb if nb2 is None else nb2, nf if nf2 is None else nf2, nk2, role="linear2")
    blocks = (TransferFunction(nb, nf, nk, role="linear1"), static(middle, "middle"), second)
    return Chain(blocks, structure="wiener_hammerstein", **limits)


@checked
@dataclass(frozen=True)
class WienerHammerstein(LinearOrders):
    """Settings of `wiener_hammerstein`; both filters have the same orders."""

    name: ClassVar[str] = "wiener_hammerstein"
    searched: ClassVar[bool] = True
    rungs: ClassVar = ({"nb": 1, "nf": 1}, {"nb": 2, "nf": 2}, {}, {"nb": 3, "nf": 3})

    def model(self) -> Chain:
        return wiener_hammerstein(self.nb, self.nf, self.nk)
