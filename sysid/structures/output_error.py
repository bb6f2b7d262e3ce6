"""Output error: B/F alone."""

from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.base.errors import unknown
from sysid.block.block import Block
from sysid.blocks import Polynomial
from sysid.model.chain import Chain
from sysid.model.recipes import LinearOrders, Order, Several, beside, choice, filters, maps

OFFSETS = ("none", "free")


@checked
def output_error(
    nb: Order = 2, nf: Order = 3, nk: Order = 1, nu: int = 1, ny: int = 1, offset: str = "none", **limits: Any
) -> Chain:
    """y = B/F u + offset with white noise at the output.

    offset: 'none', after the means were removed, or 'free'. The means of a record that begins at rest differ from its
    operating point, and without a free offset such a record can cost many times the loss. `limits` are the `fixed` and
    `bounds` of the chain, by parameter.
    """
    if offset not in OFFSETS:
        raise unknown("offset", offset, OFFSETS)
    blocks: tuple[Block, ...] = (filters(nb, nf, nk, nu, ny),)
    if offset == "free":
        blocks += (maps(Polynomial(degree=1), "output", ny),)
        names = ["output.c1"] if ny == 1 else [f"output.{j}.c1" for j in range(1, ny + 1)]
        limits["fixed"] = beside(dict.fromkeys(names, 1.0), limits.get("fixed"))
    return Chain(blocks, structure="output_error", **limits)


@checked
@dataclass(frozen=True)
class OutputError(Several, LinearOrders):
    """Settings of `output_error`."""

    name: ClassVar[str] = "output_error"
    searched: ClassVar[bool] = True
    offset: str = choice("none", "offset of the output of output_error", OFFSETS)

    def model(self, nu: int = 1, ny: int = 1) -> Chain:
        return output_error(self.nb, self.nf, self.nk, nu, ny, self.offset)

    def __str__(self) -> str:
        return super().__str__() + (" with an offset" if self.offset == "free" else "")

    def as_subject(self, fit: Any = None) -> str:
        return f"An {self.in_words(fit).replace('Output-Error', 'output-error')} model"
