"""Chain: blocks in series. Simulation, exact sensitivities and the bookkeeping of parameters."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from typing import Any, TypeVar, cast

import numpy as np

from sysid.base.checks import array, check_fields, checked, short_text
from sysid.base.errors import InputError, unknown
from sysid.base.kinds import is_number
from sysid.block.block import Block, Slot, StaticBlock
from sysid.block.symmetry import gauge
from sysid.blocks import Process, TransferFunction

C = TypeVar("C", bound=Callable[..., Any])


def checks_theta(method: C) -> C:
    """A method of a chain, `method(self, theta, ...)`, that raises InputError unless theta is (P,).

    Compiled loops read beyond a short array. What is no array of floats yet is checked and made one. Values
    of such an array are not looked at: the method is called in every step of a search, where a value that is not finite
    gives one that is not.
    """
    late = checked(late=True)(method)

    @wraps(method)
    def checked_method(self: Any, theta: Any, *args: Any, **kwargs: Any) -> Any:
        return late(self, _parameters(theta, self.names), *args, **kwargs)

    return cast(C, checked_method)


def _parameters(theta: Any, names: tuple[str, ...]) -> np.ndarray:
    """theta (P,) as floats, one value for each of `names`."""
    if type(theta) is np.ndarray and theta.dtype == np.float64 and theta.shape == (len(names),):
        return theta
    values = array("theta", theta)
    if values.shape != (len(names),):
        has = f"{len(names)} parameter{'s' if len(names) != 1 else ''}"
        listed = f" ({', '.join(names[:8])}{', ...' if len(names) > 8 else ''})" if names else ""
        raise InputError(f"theta is {short_text(values)} and the chain has {has}{listed}; give one value for each")
    return values


def columns(u: Any, inputs: int) -> list[np.ndarray]:
    """The channels of u (N, inputs), or (N,) for one, each contiguous; raises InputError for another shape."""
    if type(u) is not np.ndarray or u.dtype != np.float64:
        u = array("u", u)
    if u.ndim not in (1, 2) or (1 if u.ndim == 1 else u.shape[1]) != inputs:
        rows = "(N,) or (N, 1)" if inputs == 1 else f"(N, {inputs})"
        raise InputError(f"u is {short_text(u)} and the chain has {inputs} input(s); give an array of shape {rows}")
    return [np.ascontiguousarray(column) for column in (u[None, :] if u.ndim == 1 else u.T)]


@checked
@dataclass(frozen=True)
class Chain:
    """Blocks in series, u -> blocks[0] -> ... -> y. It holds the structure; the values are a vector theta (P,).

    Parameters are named role.name ('linear.f1'). `fixed` maps names to the values that they keep, or a block's role to
    all its values (its initial state stays free unless that is given too); `bounds` maps names to (lower, upper).
    """

    blocks: tuple[Block, ...]
    structure: str = "chain"
    fixed: Mapping[str, Any] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for block in self.blocks:
            if not isinstance(block, Block):
                raise InputError(f"blocks has {block!r}; give a Block for each")
            check_fields(block)
        roles = [b.role for b in self.blocks]
        if not self.blocks or len(set(roles)) != len(roles):
            raise InputError(f"the roles of the chain are {roles}; give at least one block, and each role once")
        for name in (self.structure, *roles):  # they stand in comments of exported code
            if not name.isprintable() or not name.strip() or "*" in name:
                raise InputError(f"{name!r} names the chain or a block of it; give letters, digits or signs but *")
        object.__setattr__(self, "fixed", self._by_name())
        for name in (*self.fixed, *self.bounds):
            if name not in self.names:
                raise unknown("parameter", name, self.names)
        for name, (low, high) in self.bounds.items():
            if not low <= high:
                raise InputError(f"the bounds of {name} are {low:g} and {high:g}; give the lower one first")
            if name in self.fixed and not low <= self.fixed[name] <= high:
                raise InputError(f"{name} is fixed at {self.fixed[name]:g}, outside its bounds; leave one out")

    def _by_name(self) -> dict[str, float]:
        """`fixed` with a block's role resolved into its parameters."""
        values_by_name: dict[str, float] = {}
        for key, value in self.fixed.items():
            block = self.block(key)
            if block is None:
                if not is_number(value) or not abs(float(value)) < np.inf:
                    raise InputError(f"{key} is fixed at {value!r}; give one finite number")
                values_by_name[key] = float(np.asarray(value))
                continue
            try:
                values = np.asarray(value, dtype=float)
            except (TypeError, ValueError):
                raise InputError(f"{key} is fixed at {value!r}; give a number for each of its parameters") from None
            count = sum(not s.initial for s in block.slots())
            if values.shape not in ((count,), (block.n_parameters,)) or not np.all(np.isfinite(values)):
                raise InputError(
                    f"{key} has {count} parameters and is fixed at {values.size} value(s); give one for each"
                )
            names = [f"{key}.{s.name}" for s in block.slots() if len(values) > count or not s.initial]
            values_by_name |= dict(zip(names, values.tolist(), strict=True))
        return values_by_name

    @cached_property
    def _slices(self) -> dict[str, slice]:
        ends = np.cumsum([b.n_parameters for b in self.blocks])
        return {b.role: slice(int(e) - b.n_parameters, int(e)) for b, e in zip(self.blocks, ends, strict=True)}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in the order of theta."""
        return tuple(f"{b.role}.{s.name}" for b in self.blocks for s in b.slots())

    @property
    def asked(self) -> tuple[Block, ...]:
        """The blocks before a fit made their maps finer, or named their shapes."""
        return tuple(asked for block in self.blocks if (asked := block.asked()) is not None)

    @cached_property
    def slots(self) -> tuple[Slot, ...]:
        """Slots of all parameters, with the bounds this chain sets."""
        slots = tuple(s for b in self.blocks for s in b.slots())
        limits = [self.bounds.get(n, (s.lower, s.upper)) for n, s in zip(self.names, slots, strict=True)]
        return tuple(replace(s, lower=lo, upper=up) for s, (lo, up) in zip(slots, limits, strict=True))

    @cached_property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (P,)."""
        return np.array([s.lower for s in self.slots]), np.array([s.upper for s in self.slots])

    @cached_property
    def free(self) -> np.ndarray:
        """True (P,) where a parameter is searched for."""
        return np.array([n not in self.fixed for n in self.names], dtype=bool)

    @cached_property
    def initial(self) -> np.ndarray:
        """True (P,) where a parameter is an initial state: it belongs to a record, not to the model."""
        return np.array([s.initial for s in self.slots], dtype=bool)

    @checked(late=True)
    def index(self, block: Block) -> slice:
        """Positions of a block's parameters in theta."""
        return self._slices[block.role]

    @checks_theta
    def part(self, theta: np.ndarray, block: Block) -> np.ndarray:
        """The part of theta that belongs to a block."""
        return theta[self.index(block)]

    @property
    def linear(self) -> TransferFunction:
        """The chain's only transfer function; raises InputError if there is none or several."""
        filters = [b for b in self.blocks if isinstance(b, TransferFunction)]
        if len(filters) != 1 or len(self.dynamics) != 1:
            raise InputError(
                f"this chain has {len(self.dynamics)} transfer functions; the call needs a chain with exactly one"
            )
        return filters[0]

    @cached_property
    def dynamics(self) -> tuple[tuple[slice, TransferFunction], ...]:
        """Every transfer function of the chain and the positions of its parameters in theta, matrices by entry."""
        filters: list[tuple[slice, TransferFunction]] = []
        for b in self.blocks:
            start = self.index(b).start
            for part, entry in b.parts():
                if isinstance(entry, TransferFunction):
                    filters.append((slice(start + part.start, start + part.stop), entry))
        return tuple(filters)

    @property
    def has_poles(self) -> bool:
        """Whether it has linear dynamics: transfer functions, or a process."""
        return bool(self.dynamics) or any(isinstance(b, Process) for b in self.blocks)

    @property
    def predicts(self) -> bool:
        """Whether the chain is fitted to predictions one step ahead, from measured outputs, not to its free run."""
        return self.blocks[-1].predicts

    @property
    def channels(self) -> tuple[int, int]:
        """Number of inputs and of outputs."""
        return self.blocks[0].channels[0], self.blocks[-1].channels[1]

    @checked
    def block(self, role: str) -> Block | None:
        """The block with this role, or None."""
        return next((b for b in self.blocks if b.role == role), None)

    def coarser(self) -> "Chain | None":
        """The chain with coarser variants of its maps; None if there are none or if parameters are held by name."""
        blocks = tuple(b.coarser() or b for b in self.blocks)
        if blocks == self.blocks or self.fixed or self.bounds:
            return None
        return replace(self, blocks=blocks)

    @checked(late=True)
    def scaled(self, u: np.ndarray, y: np.ndarray) -> "Chain":
        """The chain on the scale of a record u (N, nu), y (N, ny): blocks that have a scale and none yet take it."""
        behind = [all(isinstance(b, StaticBlock) for b in self.blocks[k + 1 :]) for k in range(len(self.blocks))]
        scaled = tuple(b.scaled(None if k else u, y if behind[k] else None) for k, b in enumerate(self.blocks))
        return self if scaled == self.blocks else replace(self, blocks=scaled)

    @checked
    def sampled(self, Ts: float) -> "Chain":
        """The chain for samples of Ts [s]: blocks whose times are in seconds take it."""
        blocks = tuple(b.sampled(Ts) for b in self.blocks)
        return self if blocks == self.blocks else replace(self, blocks=blocks)

    @checked(late=True)
    def refine(self, coarse: "Chain", theta: np.ndarray) -> np.ndarray:
        """theta (P,) with the output of the coarser chain at theta."""
        pairs = zip(self.blocks, coarse.blocks, strict=True)
        return np.concatenate([b.refine(coarse.part(theta, c)) if b != c else coarse.part(theta, c) for b, c in pairs])

    @checks_theta
    def admissible(self, theta: np.ndarray) -> bool:
        """False if theta gives no valid chain (unstable, knots out of order, outside the bounds)."""
        return bool(np.all(np.isfinite(theta))) and all(b.admissible(self.part(theta, b)) for b in self.blocks)

    @cached_property
    def basis(self) -> np.ndarray:
        """Columns (P, P): search directions; blocks with fixed parameters keep their own axes."""
        M = np.eye(len(self.names))
        for b in self.blocks:
            if self.free[self.index(b)].all():
                M[self.index(b), self.index(b)] = b.basis()
        return M

    @checks_theta
    def at_limit(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True (P,) for directions of `basis` that cannot go lower, and for those that cannot go higher."""
        low, high = self.limits
        at_low, at_high = theta <= low, theta >= high
        for b in self.blocks:
            if self.free[self.index(b)].all():
                at_low[self.index(b)] |= b.at_low(self.part(theta, b))
        return at_low, at_high

    @checks_theta
    def repair(self, theta: np.ndarray) -> np.ndarray:
        """theta within the bounds and with every block's own repair."""
        theta = np.clip(theta, *self.limits)
        for b in self.blocks:
            theta[self.index(b)] = b.repair(self.part(theta, b))
        return theta

    @checks_theta
    def simulate(self, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Free run of one input and output: output (N,) for input u (N,)."""
        return self.outputs(theta, u)[:, 0]

    @checks_theta
    def tangent(self, theta: np.ndarray, u: np.ndarray, y: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """`sensitivities` of one input and output: output (N,) and dy/dtheta (N, P)."""
        output, J = self.sensitivities(theta, u, y=y)
        return output[:, 0], J

    @checks_theta
    def outputs(self, theta: np.ndarray, u: np.ndarray, y: np.ndarray | None = None) -> np.ndarray:
        """Free run: outputs (N, ny) for inputs u (N, nu) or (N,); with measured y (N, ny) as `sensitivities`."""
        xs = deque(self._signals(theta, u, y), maxlen=1).pop()
        return np.column_stack(xs) if len(xs) > 1 else xs[0][:, None]

    @checks_theta
    def sensitivities(
        self, theta: np.ndarray, u: np.ndarray, out: np.ndarray | None = None, y: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (N, ny) and their exact Jacobian (ny N, P), the first output's rows first.

        `out` (N, P) may receive the Jacobian of one input and output: allocation takes as long as use for a long
        record. With measured outputs y (N, ny), a chain that `predicts` gives its prediction one step ahead.
        """
        xs, Js = self._run(theta, u, out, y)
        return np.column_stack(xs), Js[0] if len(Js) == 1 else np.concatenate(Js)

    @checks_theta
    def signals(self, theta: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, ...]:
        """Every signal of the free run for u (N, nu) or (N,): entry k goes into block k, the last one is the output.

        Each is (N,) where it has one channel, else (N, channels).
        """
        return tuple(xs[0] if len(xs) == 1 else np.column_stack(xs) for xs in self._signals(theta, u))

    @checks_theta
    def remarks(self, theta: np.ndarray, u: np.ndarray) -> list[str]:
        """What the free run for u (N, nu) or (N,) should be told with, for example a motor that runs away."""
        runs = self.signals(theta, u)
        pairs = zip(self.blocks, runs[:-1], runs[1:], strict=True)
        return [text for b, x, y in pairs for text in b.remarks(self.part(theta, b), x, y)]

    @checks_theta
    def through(self, theta: np.ndarray, x: np.ndarray, start: int = 0, stop: int | None = None) -> np.ndarray:
        """x (N,) or (N, channels) through blocks[start:stop], (N,) where it comes out of one channel."""
        with np.errstate(over="ignore", invalid="ignore"):
            for b in self.blocks[start:stop]:
                xs = columns(x, b.channels[0])
                xs = b.propagate_all(self.part(theta, b), xs, [np.empty((len(x), 0))] * len(xs), 0)[0]
                x = xs[0] if len(xs) == 1 else np.column_stack(xs)
        return x

    @checks_theta
    def kinks(self, theta: np.ndarray, tangent: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Kinks of all maps (k,) and their derivative (k, P), see `Block.kinks`."""
        values, rows = [np.empty(0)], [np.empty((0, len(theta)))]
        for b in self.blocks:
            for part, entry in b.parts():
                positions = slice(self.index(b).start + part.start, self.index(b).start + part.stop)
                kink, d = entry.kinks(theta[positions], tangent)
                wide = np.zeros((len(kink), len(theta)))
                wide[:, positions] = d
                values.append(kink)
                rows.append(wide)
        return np.concatenate(values), np.concatenate(rows)

    @checks_theta
    def gauge(self, theta: np.ndarray) -> np.ndarray:
        """Basis (P, g) of redundant directions among the free parameters, see `sysid.block.symmetry`."""
        array("theta", theta)  # finite: what follows decomposes it
        symmetries = [b.symmetries(self.part(theta, b)) for b in self.blocks]
        widths = [self.blocks[0].channels[0], *(b.channels[1] for b in self.blocks)]
        return gauge(symmetries, [b.n_parameters for b in self.blocks], widths, self.free)

    @checks_theta
    def count(self, theta: np.ndarray) -> int:
        """d of the criteria: free parameters after the gauge, initial states counted."""
        return int(self.free.sum()) - self.gauge(theta).shape[1]

    def _signals(self, theta: np.ndarray, u: np.ndarray, y: np.ndarray | None = None) -> Iterator[list[np.ndarray]]:
        """The channels of every signal in turn, each an array (N,), so that a long record does not keep them all."""
        xs = columns(u, self.channels[0])
        none = np.empty((len(xs[0]), 0))
        yield xs
        for b in self.blocks:
            with np.errstate(over="ignore", invalid="ignore"):  # an unstable trial overflows; its cost is then infinite
                xs = self._through(b, theta, xs, [none] * len(xs), 0, y)[0]
            yield xs

    def _run(
        self, theta: np.ndarray, u: np.ndarray, out: np.ndarray | None, y: np.ndarray | None
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        xs, q = columns(u, self.channels[0]), 0
        shape = (len(xs[0]), len(theta))
        # With several channels, the columns of the other channels' parameters stay zero.
        if self.channels == (1, 1):
            Js = [np.empty(shape) if not isinstance(out, np.ndarray) or out.shape != shape else out]
        else:
            Js = [np.zeros(shape) for _ in xs]
        with np.errstate(over="ignore", invalid="ignore"):
            for b in self.blocks:
                xs, Js = self._through(b, theta, xs, Js, q, y)
                q += b.n_parameters
        return xs, Js

    def _through(
        self, b: Block, theta: np.ndarray, xs: list[np.ndarray], Js: list[np.ndarray], q: int, y: np.ndarray | None
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """`propagate_all` of a block, or its prediction of the measured y (N, ny), which the last block alone makes."""
        part = self.part(theta, b)
        if y is None or b is not self.blocks[-1]:
            return b.propagate_all(part, xs, Js, q)
        return b.predict_all(part, xs, Js, q, y)
