"""Box-Jenkins: B/F beside noise with poles and zeros of its own, fitted to predictions one step ahead."""

from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.blocks import BoxJenkins as Block
from sysid.model.chain import Chain
from sysid.model.recipes import OFFSETS, LinearOrders, choice, offset_of_input, order


@checked(deferred=("nb", "nf", "nk", "nc", "nd"))
def bj(nb: int = 2, nf: int = 3, nk: int = 1, nc: int = 2, nd: int = 2, offset: str = "free", **limits: Any) -> Chain:
    """y = B/F (u + offset) + C/D e: a stable plant in noise that is none of its own doing, such as drift or waves.

    F has nf coefficients, C nc and D nd. What is fitted is the prediction one step ahead, so that no colour of the
    noise costs precision, as it costs `output_error`, and the plant is right even where C/D is too small for the
    noise, as `armax` is not (Ljung, System Identification, 2nd ed. 1999, section 8.4). `offset` is "free" for a
    constant at the input, "each" for one of every experiment, or "none". `limits` are the `fixed` and `bounds` of the
    chain, by parameter.
    """
    block = Block(nb, nf, nk, nc=nc, nd=nd, role="linear")
    return Chain((*offset_of_input(offset), block), structure="bj", **limits)


@checked
@dataclass(frozen=True)
class BoxJenkins(LinearOrders):
    """Settings of `bj`."""

    name: ClassVar[str] = "bj"
    called: ClassVar[str] = "Box-Jenkins"
    nc: int = order(2, "coefficients of C, the noise's zeros")
    nd: int = order(2, "coefficients of D, the noise's poles")
    offset: str = choice("free", "offset of the input of a Box-Jenkins model", OFFSETS)

    def model(self) -> Chain:
        return bj(self.nb, self.nf, self.nk, self.nc, self.nd, self.offset)
