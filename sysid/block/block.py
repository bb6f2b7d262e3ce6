"""A block of a chain: output, exact tangent, and the symmetries that make parameters redundant."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sysid.base.errors import InputError
from sysid.block.symmetry import Symmetry
from sysid.block.writing import CCode, Code, Writer


@dataclass(frozen=True)
class Slot:
    """One parameter of a block: name, unit, bounds.

    `initial`: an initial state, which belongs to a record and not to the model; `knot`: a position on a map's input
    axis.
    """

    name: str
    unit: str = ""
    lower: float = -np.inf
    upper: float = np.inf
    initial: bool = False
    holds: bool = False  # an initial state that a block at rest keeps (a position), not one that is then zero (a speed)
    knot: bool = False
    words: str = ""  # of a value that people are told with its interval; Y and U of its unit are the record's


class Law(NamedTuple):
    """A block in other units, see `Block.law`: itself there, and M (p, p): its theta here is M times theta there."""

    block: "Block"
    M: np.ndarray


# Runs a block on consecutive pieces of a record: y (n,) of a piece x (n,), whose J (n, P) it overwrites.
Piecewise = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Block(ABC):
    """One element of a chain. A block has only structure; parameter values theta (p,) are arguments."""

    role: str = field(default="block", kw_only=True)
    centred: ClassVar[bool] = False  # whether a fit takes the means off its signals, see `sysid.model.transforms`
    predicts: ClassVar[bool] = False  # whether it predicts measured outputs where it is the last of a chain
    compiles_long: ClassVar[bool] = False  # whether its loops take several times as long as a new process to start

    def __getstate__(self) -> dict[str, Any]:
        """Its fields: compiled kernels are made anew where a copy or another process needs them."""
        names = {f.name for f in fields(self)}
        return {name: value for name, value in vars(self).items() if name in names}

    @abstractmethod
    def slots(self) -> tuple[Slot, ...]:
        """The parameters in the order of theta."""

    @abstractmethod
    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        """Output y (N,) for input x (N,).

        J (N, P) holds the tangent of x in its first q columns and is overwritten by the tangent of y; the columns
        q..q+p-1 are filled with dy/dtheta. With P = 0 only the output is computed.
        """

    def output(self, theta: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Output (N,) of a single-channel block for input x (N,)."""
        x = np.ascontiguousarray(x, dtype=float)
        return self.propagate(theta, x, np.empty((len(x), 0)), 0)

    def propagate_all(
        self, theta: np.ndarray, xs: list[np.ndarray], Js: list[np.ndarray], q: int
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """The same for a list of channels, each with its own J; single-channel blocks need not override it."""
        return [self.propagate(theta, xs[0], Js[0], q)], Js

    def predict_all(
        self, theta: np.ndarray, xs: list[np.ndarray], Js: list[np.ndarray], q: int, y: np.ndarray
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """`propagate_all` of a block that `predicts`, with the measured outputs y (N, ny); others do not use them."""
        return self.propagate_all(theta, xs, Js, q)

    def piecewise(self, theta: np.ndarray, q: int, P: int) -> Piecewise | None:
        """`propagate` piece by piece, carrying the state from one piece to the next, for J (n, P) of every piece.

        The pieces together give what `propagate` gives on the whole record. None if this block needs it whole.
        """
        return None

    def parts(self) -> list[tuple[slice, "Block"]]:
        """The single-channel blocks of this block, and the positions of their parameters in theta."""
        return [(slice(0, self.n_parameters), self)]

    @property
    def channels(self) -> tuple[int, int]:
        """Number of inputs and of outputs."""
        return 1, 1

    @abstractmethod
    def start(self, x: np.ndarray) -> np.ndarray:
        """theta (p,) that makes this block the identity on the range of x (N,), or as near as possible."""

    def scaled(self, u: np.ndarray | None, y: np.ndarray | None) -> "Block":
        """This block on the scale of a record's input u (N, nu) and output y (N, ny), None where it meets neither."""
        return self

    def sampled(self, Ts: float) -> "Block":
        """This block for samples of Ts [s]; itself if its times count in samples."""
        return self

    def resting(self) -> "Block":
        """The block for a run from rest, where it differs: a delay then holds zeros from before the input begins."""
        return self

    def recalling(self, theta: np.ndarray, every: bool) -> "Block | None":
        """This block with the input before a record, or `every` one that it still sees, as a parameter u0, u1, ...

        None of a block that sees none beyond those that it has.
        """
        return None

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        """This block for an input x' = x / a (a (inputs,)) and an output y' = y / b (b (outputs,)).

        a and b are powers of two or their negatives, so that nothing is rounded. None if the block cannot be in such
        units, or if its numbers are physical ones.
        """
        return None

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        """The block's symmetries at theta."""
        return []

    def admissible(self, theta: np.ndarray) -> bool:
        """False if theta gives no valid block (an unstable filter, knots out of order)."""
        return True

    def remarks(self, theta: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[str]:
        """What a run with input x (N,) and output y (N,) should be told with: one sentence each, mostly none."""
        return []

    def repair(self, theta: np.ndarray) -> np.ndarray:
        """The admissible theta used in place of an inadmissible one; theta itself if there is none."""
        return theta

    def at_low(self, theta: np.ndarray) -> np.ndarray:
        """True (p,) for directions of `basis` at a lower limit set by the block itself."""
        return np.zeros(self.n_parameters, dtype=bool)

    def basis(self) -> np.ndarray:
        """Columns (p, p): the search directions of this block's parameters."""
        return np.eye(self.n_parameters)

    def coarser(self) -> "Block | None":
        """A smaller block that is easier to fit, or None; `refine` converts its parameters back."""
        return None

    def refine(self, theta: np.ndarray) -> np.ndarray:
        """theta (p,) of this block that gives exactly the curve of its coarser block at theta."""
        return theta

    def finer(self, theta: np.ndarray, x: np.ndarray, knots: int) -> "tuple[Block, np.ndarray] | None":
        """This map with `knots` break points at fixed places over the range of x (N,), and its theta with this curve.

        None of a block that is no map on break points, or whose number of them is given.
        """
        return None

    def asked(self) -> "Block | None":
        """The map that a fit made this one from; itself if it is none of these, None where nothing was asked for."""
        return self

    def slope_changes(self) -> np.ndarray:
        """Rows (k, p): rows theta are the changes of slope of a map at the many fixed places that `finer` gave it."""
        return np.empty((0, self.n_parameters))

    def wider(self, theta: np.ndarray) -> "tuple[Block, np.ndarray, float] | None":
        """A finer map with one more place on each side, its theta with the same curve, and its mean slope there."""
        return None

    def kinks(self, theta: np.ndarray, tangent: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Change of slope at each inner knot (k,), divided by the map's mean slope, and the derivative (k, p).

        Without `tangent` a block may leave the derivative at zero, which most trials of a search do not need.
        It must not depend on the gauge. Each kink counts as one sample in the cost of a fit, see
        `Objective.curvature_weight`.
        """
        return np.empty(0), np.empty((0, len(theta)))

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Another start near theta for the multi-start."""
        return theta

    def c(self, theta: np.ndarray) -> CCode:
        """C99 code of this block, for `export_c`; theta says only how far it must look back. Raises InputError if the
        block has none.
        """
        raise NotImplementedError

    def python(self, theta: np.ndarray) -> Code:
        """Python code of this block with these numbers, for `export_python`."""
        raise NotImplementedError

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        """The block with its numbers as equations, for `closed_form`."""
        raise NotImplementedError

    @cached_property
    def has_basis(self) -> bool:
        """True if `basis` is not the identity."""
        return not np.array_equal(self.basis(), np.eye(self.n_parameters))

    @cached_property
    def n_parameters(self) -> int:
        """Number of parameters p."""
        return len(self.slots())


def no_width(block: Block, theta: np.ndarray) -> InputError:
    """The error for parameters with which a map has no slope: break points, or ends, that stand at one place."""
    pairs = list(zip(block.slots(), np.asarray(theta).tolist(), strict=False))
    values = ", ".join(f"{s.name} = {v:g}" for s, v in pairs[:8])
    return InputError(f"{block.role} divides by zero with {values}; give break points apart, in rising order")


class StaticBlock(Block):
    """A memoryless map: subclasses give value, slope and own Jacobian; this class applies the chain rule."""

    def straight(self, x: np.ndarray) -> np.ndarray:
        """theta (p,) whose map is a straight line over the range of x (N,), as nearly as the map has one.

        A `start` may bend inside that range, so that each parameter has an effect; this one need not.
        """
        return self.start(x)

    @abstractmethod
    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        """f(x) (N,) and f'(x) (N,); fills columns q..q+p-1 of J (N, P) with df/dtheta unless P = 0."""

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        try:
            y, slope = self.evaluate(theta, x, J, q)
        except ZeroDivisionError:
            raise no_width(self, theta) from None
        if J.shape[1] and q:
            from sysid.block.kernels import scale_columns

            scale_columns(J, q, slope)
        return y

    def piecewise(self, theta: np.ndarray, q: int, P: int) -> Piecewise | None:
        return lambda x, J: self.propagate(theta, x, J, q)
