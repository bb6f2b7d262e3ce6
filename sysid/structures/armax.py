"""ARMAX: B/A with a state estimator, fitted to predictions one step ahead."""

from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.blocks import Innovations, static
from sysid.model.chain import Chain
from sysid.model.recipes import OFFSETS, LinearOrders, Map, choice, offset_of_input, static_map


@checked(deferred=("nb", "nf", "nk"))
def armax(
    nb: int = 2, nf: int = 3, nk: int = 1, input: Map | None = None, offset: str = "free", **limits: Any
) -> Chain:
    """A y = B (f(u) + offset) + C e: for plants that are not stable or integrate, and records of a closed loop.

    A and C have nf coefficients. What is fitted is the prediction one step ahead from all measured outputs before, so
    that poles may lie anywhere and feedback does not bias them, as long as e is white. `input` is a static map f, none
    by default. `offset` is "free" for a constant at the input, such as a load, where no map is there to hold it,
    "each" for one of every experiment, or "none". `limits` are the `fixed` and `bounds` of the chain, by parameter.
    """
    before = (static(input, "input"),) if input is not None else offset_of_input(offset)
    return Chain((*before, Innovations(nb, nf, nk, role="linear")), structure="armax", **limits)


@checked
@dataclass(frozen=True)
class Armax(LinearOrders):
    """Settings of `armax`."""

    name: ClassVar[str] = "armax"
    called: ClassVar[str] = "ARMAX"
    input_map: str | None = static_map("input map", "static map before the linear block")
    offset: str = choice("free", "offset of the input, a parameter where there is no input map", OFFSETS)

    def model(self) -> Chain:
        return armax(self.nb, self.nf, self.nk, self.input_map, self.offset)
