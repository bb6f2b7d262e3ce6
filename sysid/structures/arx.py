"""ARX: B/A whose predictions come from the measured outputs alone, by least squares."""

from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.blocks import Innovations
from sysid.model.chain import Chain
from sysid.model.recipes import OFFSETS, LinearOrders, beside, choice, offset_of_input


@checked(deferred=("nb", "nf", "nk"))
def arx(nb: int = 2, nf: int = 3, nk: int = 1, offset: str = "free", **limits: Any) -> Chain:
    """A y = B (u + offset) + e: `armax` with C = 1, whose loss has one minimum, that of linear least squares.

    A has nf coefficients. The first samples are those of a full initial state, so that the loss is the sum over the
    samples that have all their past. White noise at the output biases A: then use `armax` or `output_error`. `offset`
    is "free" for a constant at the input, "each" for one of every experiment, or "none". `limits` are the `fixed` and
    `bounds` of the chain, by parameter.
    """
    block = Innovations(nb, nf, nk, role="linear")
    plain = {f"linear.c{k}": 0.0 for k in range(1, nf + 1)}
    fixed = beside(plain, limits.pop("fixed", None))
    return Chain((*offset_of_input(offset), block), structure="arx", fixed=fixed, **limits)


@checked
@dataclass(frozen=True)
class Arx(LinearOrders):
    """Settings of `arx`."""

    name: ClassVar[str] = "arx"
    called: ClassVar[str] = "ARX"
    offset: str = choice("free", "offset of the input of an ARX model", OFFSETS)

    def model(self) -> Chain:
        return arx(self.nb, self.nf, self.nk, self.offset)
