"""Output error: B/F alone."""

from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.model.chain import Chain
from sysid.model.recipes import LinearOrders, Order, filters


def output_error(nb: Order = 2, nf: Order = 3, nk: Order = 1, nu: int = 1, ny: int = 1, **limits: Any) -> Chain:
    """y = B/F u with white noise at the output. It has no offset: remove the means first.

    `limits` are the `fixed` and `bounds` of the chain, by parameter.
    """
    return Chain((filters(nb, nf, nk, nu, ny),), structure="output_error", **limits)


@dataclass(frozen=True)
class OutputError(LinearOrders):
    """Settings of `output_error`."""

    name: ClassVar[str] = "output_error"
    searched: ClassVar[bool] = True

    def model(self) -> Chain:
        return output_error(self.nb, self.nf, self.nk)

    def as_subject(self, fit: Any = None) -> str:
        return f"An {self.in_words(fit).replace('Output-Error', 'output-error')} model"
