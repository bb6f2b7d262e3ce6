"""Nonlinear state space: a linear one with a tanh network or a polynomial in its state equation."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.blocks import StateSpace, static
from sysid.model.chain import Chain
from sysid.model.recipes import Map, Several, choice, number, order, static_map

READOUTS = ("network", "linear")
_STATES = 6  # how far a structure search goes, and in which steps
_UNITS, _SPREADS = (0, 2, 5, 10, 20), (0.03, 0.1, 0.3, 1.0, 3.0)


@checked
def state_space(
    nx: int = 2,
    units: int = 5,
    degree: int = 0,
    output: Map | None = None,
    nu: int = 1,
    ny: int = 1,
    readout: str = "network",
    spread: float = 0.3,
    **limits: Any,
) -> Chain:
    """x(t+1) = A x + B u + E f(x, u), y = C x + D u + d + F f(x, u) with nx states, f of tanh units and a polynomial.

    The polynomial has all monomials of the state and the input of degree 2 to `degree`. readout is "network", or
    "linear" for an output without F. `spread` is the size of the network's weights before the record is seen, on
    signals of size 1: 1 lets it bend, 0.1 keeps it nearly linear where the record does not insist. `output` is a static
    map behind, for one output. Signals are scaled by the record inside, so units and offsets do not matter. It is the
    general model of a plant of which no structure is known; where a structure with fewer parameters fits as well, that
    one extrapolates better. `limits` are the `fixed` and `bounds` of the chain, by parameter.
    """
    if readout not in READOUTS:
        raise unknown("readout", readout, READOUTS)
    block = StateSpace(nx, units, degree, readout == "network", nu, ny, spread=spread, role="state")
    blocks = (block,) if output is None else (block, static(output, "output"))
    return Chain(blocks, structure="state_space", **limits)


@checked
@dataclass(frozen=True)
class NonlinearStateSpace(Several):
    """Settings of `state_space`."""

    name: ClassVar[str] = "state_space"
    searched: ClassVar[bool] = True
    rungs: ClassVar[tuple[dict[str, Any], ...]] = (
        *({"nx": nx, "units": 5} for nx in (1, 2, 3, 4)),
        {"nx": 2, "units": 5, "readout": "linear"},
        {"nx": 2, "units": 0, "degree": 3, "readout": "linear"},
    )
    nx: int = order(2, "states", least=1)
    units: int = order(5, "units of the network")
    degree: int = order(0, "degree of the polynomial of state and input, 0 for none")
    readout: str = choice("network", "what the output of a state space sees beside states and input", READOUTS)
    spread: float = number(0.3, "size of the weights of a state space's network before the record is seen", unit="")
    output_map: str | None = static_map("output map", "static map after the state space")

    def model(self, nu: int = 1, ny: int = 1) -> Chain:
        if self.output_map is not None and ny > 1:
            raise InputError(f"a state space of {ny} outputs takes no output map; leave it out")
        return state_space(self.nx, self.units, self.degree, self.output_map, nu, ny, self.readout, self.spread)

    def neighbours(self) -> "tuple[NonlinearStateSpace, ...]":
        """One state more or less, more or fewer units, the other readout, a network that bends more or less."""
        steps: list[dict[str, Any]] = [{"nx": self.nx + 1}, {"nx": self.nx - 1}]
        if not self.degree:
            steps += [{"units": n} for n in _beside(_UNITS, self.units)]
            steps += [{"spread": value} for value in _beside(_SPREADS, self.spread)]
        steps.append({"readout": READOUTS[1 - READOUTS.index(self.readout)]})
        return tuple(replace(self, **step) for step in steps if 1 <= step.get("nx", self.nx) <= _STATES)


def _beside(ladder: tuple[Any, ...], value: float) -> list[Any]:
    """The rungs of a rising ladder next to a value."""
    return [*[x for x in ladder if x < value][-1:], *[x for x in ladder if x > value][:1]]
