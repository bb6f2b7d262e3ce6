"""A dynamic block from a user's step function, with exact gradients and C and Python export."""

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.block.block import Slot
from sysid.block.compiler.checks import check_rows
from sysid.block.compiler.ir import Program
from sysid.block.compiler.recursion import Recursion, step_text
from sysid.block.compiler.subset import read
from sysid.block.symmetry import Symmetry
from sysid.blocks.custom import redundant

_PROBE = 400  # samples


@checked(deferred=("lower", "upper"))
@dataclass(frozen=True)
class Dynamic(Recursion):
    """A user's step, made with `dynamic`, which describes the allowed language. It consists of text and numbers.

    `names` and `first` (p,) are the parameters and their start values, `lower` and `upper` (p,) their bounds. `records`
    names the initial states, and `holding` those that the block keeps at rest.
    """

    text: str
    names: tuple[str, ...] = ()
    first: tuple[float, ...] = ()
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()
    records: tuple[str, ...] = ()
    holding: tuple[str, ...] = ()
    span: tuple[float, float] = (-1.0, 1.0)

    def __post_init__(self) -> None:
        program = self.program()
        if program.consts:
            raise InputError(f"a user's step has no block to read {program.consts[0]} from; write the number")
        if not len(self.names) == len(set(self.names)) == len(self.first) == len(self.lower) == len(self.upper):
            raise InputError("a step's parameters need one start value, lower and upper bound each, and each name once")
        for name in (*self.records, *self.holding):
            if name not in self.names:
                raise unknown("parameter", name, self.names)
        checked_span(self.span)
        rows = {r: [n for n in self.names if n.removeprefix(r).isdigit()] for r in program.rows}
        declared = {*self.names, *(r for r, names in rows.items() if names)}
        missing = [n for n in (*program.params, *program.rows) if n not in declared]
        idle = set(self.names) - set(program.params) - {n for names in rows.values() for n in names}
        if missing or idle:
            fault = f"reads {missing[0]}, which is not a parameter" if missing else f"never reads {min(idle)}"
            raise InputError(f"the step {fault}; its parameters are {', '.join(self.names) or 'none'}")
        check_rows(program, {r: len(names) for r, names in rows.items()})
        if not self.admissible(np.array(self.first)):
            raise InputError(f"the start values {self.first} are outside the bounds; give values within them")

    def slots(self) -> tuple[Slot, ...]:
        bounds = zip(self.names, self.lower, self.upper, strict=True)
        return tuple(Slot(n, "", lo, up, n in self.records, n in self.holding) for n, lo, up in bounds)

    @cached_property
    def _program(self) -> Program:
        return read(self.text)  # text from a file is read like any other, and never run

    def _key(self) -> str:
        return hashlib.blake2b(self.text.encode(), digest_size=12).hexdigest()

    def _folder(self) -> Path | None:
        return None  # the library's own folder is not the place for a user's kernels

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.array(self.first, dtype=float)

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(np.all(theta >= self.lower) and np.all(theta <= self.upper))

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Every parameter changed by a factor of up to about two, within the bounds."""
        return np.clip(theta * np.exp(0.4 * rng.normal(size=len(theta))), self.lower, self.upper)

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        """Symmetries with neighbouring blocks, found numerically on a record of noise and holds over `span`.

        A parameter without effect on this record is left out.
        """
        rng = np.random.default_rng(0)
        x = np.repeat(rng.uniform(*self.span, _PROBE // 8), 8) + 0.1 * (self.span[1] - self.span[0]) * rng.normal(
            size=_PROBE
        )
        J = np.zeros((_PROBE, 2 + len(theta)))
        J[:, 0], J[:, 1] = x, 1.0
        y = self.propagate(theta, x, J, 2)
        active = np.any(J[:, 2:] != 0.0, axis=0)
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(y))):
            return []
        directions = redundant(np.column_stack([J[:, 2:][:, active], J[:, :2], -y, -np.ones(_PROBE)]))
        wide = []
        for s in directions:
            d_theta = np.zeros(len(theta))
            d_theta[active] = s.d_theta
            wide.append(Symmetry(d_theta, s.in_scale, s.in_shift, s.out_scale, s.out_shift))
        return wide


@checked(late=True)
def dynamic(
    step: Callable | str,
    parameters: Mapping[str, float | Sequence[float]],
    *,
    begin: Callable | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    initial: Sequence[str] = (),
    holds: Sequence[str] = (),
    span: tuple[float, float] = (-1.0, 1.0),
    role: str = "block",
) -> Dynamic:
    """A block from `step(s, x, p)`: reads states, input and parameters, sets the next states, returns y.

    It reads s.name, x and p.name. Derivatives, compiled code, C and Python are derived from its source.

    A step may use numbers, + - * / **, comparisons, and, or, not, if, for _ in range(n), break, return, the functions
    of `sysid.block.compiler.functions` (exp, log, logistic, sin, floor, abs, min and more; a refused step lists all),
    ago(x, n) for the input n samples ago, and small functions of the same kind, no lambdas. States start at zero, or at
    the values set by `begin(s, x, p)` at the first sample. If Python cannot find the source (at a prompt), give the
    text of both functions as `step`. The derivative at a switch is that of the branch taken: a parameter that only
    shifts a jump, or whose branch is never taken, has derivative zero, and no search can estimate it. docs/house.md has
    an example from the step to the fit and its C code.

    `parameters` has a start value for each name, several for a row p.name[i]; `bounds` is by name. In a chain
    a parameter is called role.name, so give each block its `role`. `initial` names the
    initial states, and `holds` those that a block at rest keeps (a position, not a speed). `span` is the range of x
    over which gains and offsets that a neighbouring block could represent are searched. Raises InputError, with the
    line, for anything else.
    """
    if not isinstance(step, str) and not callable(step):
        raise InputError(f"step is a {type(step).__name__}; give a function or its text")
    if isinstance(step, str):
        if begin is not None:
            raise InputError("step is text and begin is not; put def begin(s, x, p) into the same text")
        text = step
    else:
        text = step_text({"step": step} if begin is None else {"step": step, "begin": begin})
    for mapping, what in ((parameters, "parameters"), (bounds or {}, "bounds")):
        if not isinstance(mapping, Mapping) or not all(isinstance(n, str) and n.isidentifier() for n in mapping):
            raise InputError(f"{what} is {mapping!r}; give a dict by the names of the parameters")
    if not isinstance(role, str) or not role.isidentifier():
        raise InputError(f"role is {role!r}; give a name of letters, digits and _")
    first: dict[str, float] = {}
    limits: list[tuple[float, float]] = []
    for name, value in parameters.items():
        numbers = _numbers(name, value)
        entries = {f"{name}{k}": v for k, v in enumerate(numbers)} if np.ndim(value) else {name: numbers[0]}
        if clash := {*entries} & {*first}:
            raise InputError(f"two parameters are called {min(clash)}; rename the row {name} or the other")
        first |= entries
        limits += [_pair(name, (bounds or {}).get(name, (-np.inf, np.inf)))] * len(entries)
    for name in bounds or {}:
        if name not in parameters:
            raise unknown("parameter", name, tuple(parameters))
    lower, upper = (tuple(limit[k] for limit in limits) for k in (0, 1))
    lists = _names("initial", initial), _names("holds", holds)
    if late := [n for n in lists[1] if n not in lists[0]]:
        raise InputError(f"holds names {late[0]}, which is not in initial; name it in both")
    return Dynamic(text, tuple(first), tuple(first.values()), lower, upper, *lists, checked_span(span), role=role)


def _numbers(name: str, value: object) -> tuple[float, ...]:
    """The start value of a parameter, or those of a row."""
    try:
        if isinstance(value, str) or np.iscomplexobj(value) or np.ndim(value) > 1:  # type: ignore[arg-type]
            raise ValueError
        numbers = tuple(float(v) for v in np.atleast_1d(np.asarray(value, dtype=float)))
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    if not numbers or not np.all(np.isfinite(numbers)):
        raise InputError(f"the start value of {name} is {value!r}; give a finite number, or several for a row")
    return numbers


def _pair(name: str, value: object) -> tuple[float, float]:
    """Bounds of a parameter."""
    try:
        lower, upper = (float(v) for v in value)  # type: ignore[attr-defined]
    except (TypeError, ValueError, OverflowError):
        lower, upper = np.nan, np.nan
    if not lower <= upper:
        raise InputError(f"the bounds of {name} are {value!r}; give two numbers (lower, upper), lower <= upper")
    return lower, upper


def _names(what: str, value: Sequence[str]) -> tuple[str, ...]:
    """A list of parameter names."""
    names = [] if isinstance(value, str) or not isinstance(value, Iterable) else [*value]
    if isinstance(value, str) or not isinstance(value, Iterable) or not all(isinstance(n, str) for n in names):
        raise InputError(f"{what} is {value!r}; give a list of the names of parameters")
    return tuple(names)


def checked_span(value: object) -> tuple[float, float]:
    """The range of x, two increasing finite numbers."""
    try:
        low, high = (float(v) for v in value)  # type: ignore[attr-defined]
    except (TypeError, ValueError, OverflowError):
        low, high = np.nan, np.nan
    if not (low < high and np.isfinite(high - low)):
        raise InputError(f"span is {value!r}; give two finite numbers (lower, upper), lower < upper")
    return low, high
