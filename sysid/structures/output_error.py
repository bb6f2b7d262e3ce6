"""Output error: B/F alone."""

from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.model.chain import Chain
from sysid.model.recipes import LinearOrders, Order, Several, filters, with_offset, zero_of_output


@checked
def output_error(
    nb: Order = 2, nf: Order = 3, nk: Order = 1, nu: int = 1, ny: int = 1, offset: str = "none", **limits: Any
) -> Chain:
    """y = B/F u + offset with white noise at the output.

    offset: 'none', after the means were removed, or 'free'. The means of a record that begins at rest differ from its
    operating point, and without a free offset such a record can cost many times the loss. `limits` are the `fixed` and
    `bounds` of the chain, by parameter.
    """
    return Chain(with_offset([filters(nb, nf, nk, nu, ny)], ny, offset), structure="output_error", **limits)


@checked
@dataclass(frozen=True)
class OutputError(Several, LinearOrders):
    """Settings of `output_error`."""

    name: ClassVar[str] = "output_error"
    searched: ClassVar[bool] = True
    offset: str = zero_of_output()

    def model(self, nu: int = 1, ny: int = 1) -> Chain:
        return output_error(self.nb, self.nf, self.nk, nu, ny, self.offset)

    def __str__(self) -> str:
        return super().__str__() + (" without an offset" if self.offset == "none" else "")

    def as_subject(self, fit: Any = None) -> str:
        return f"An {self.in_words(fit).replace('Output-Error', 'output-error')} model"
