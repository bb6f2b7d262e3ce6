"""Setting: the model to fit, how, and what is known of it before (parameters held or bounded, a fit to start from)."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.base.rates import same_rate
from sysid.block.block import StaticBlock
from sysid.blocks import STATIC, Channels, StateSpace
from sysid.channels.conversion import convert
from sysid.data.record import IOData
from sysid.estimation.objective import Objective
from sysid.estimation.result import Fit
from sysid.estimation.starts._start import clip_to_bounds, start_maps
from sysid.fitting import load
from sysid.model.chain import Chain
from sysid.model.recipes import Recipe
from sysid.solver.searches import TABLE as SEARCHES
from sysid.structures import HammersteinWiener
from sysid.workflow.record import Record

MOST = 12  # names of one block in a sentence


@dataclass(frozen=True)
class Held:
    """Parameters by name ('linear.f1'): `fixed` at a value, or at the start's if it is None; `bounds` (low, high).

    `fixed` may name a whole block too, which then keeps its start. `start` is a saved fit, read from `path`: of the
    same structure, or of the linear filter of a model with static maps, which then start as straight lines.
    """

    fixed: tuple[tuple[str, float | None], ...] = ()
    bounds: tuple[tuple[str, tuple[float, float]], ...] = ()
    start: Fit | None = field(default=None, compare=False)
    path: Path | None = None

    def __bool__(self) -> bool:
        return bool(self.fixed or self.bounds or self.start is not None)

    def as_dict(self) -> dict[str, Any]:
        """What is held, for a summary; empty if nothing is."""
        if not self:
            return {}
        bounds = {name: list(pair) for name, pair in self.bounds}
        return {"fixed": dict(self.fixed), "bounds": bounds, "from": None if self.path is None else str(self.path)}

    def options(self) -> tuple[str, ...]:
        """The same as options of the command line."""
        words: list[str] = [] if self.path is None else ["--from", str(self.path)]
        for name, value in self.fixed:
            words += ["--fix", name if value is None else f"{name}={value:.12g}"]
        for name, (low, high) in self.bounds:
            ends = ("" if np.isinf(end) else f"{end:.12g}" for end in (low, high))
            words += ["--bound", f"{name}={':'.join(ends)}"]
        return tuple(words)

    def without_start(self) -> "Held":
        """The same without the saved fit, and without what was held at its values."""
        return Held(tuple(pair for pair in self.fixed if pair[1] is not None), self.bounds)

    def apply(self, chain: Any, data: IOData, with_parts: bool = False) -> tuple[Any, np.ndarray | None]:
        """The model with all this, and its starting point theta (P,) if there is a saved fit.

        Of a structure `with_parts` a saved fit keeps the parts that it has.

        Raises InputError for a name that the chain lacks, for values that a parameter cannot have, and for a saved fit
        of another model.
        """
        if not self:
            return chain, None
        if not isinstance(chain, Chain):
            raise InputError(
                "a nonlinear ARX model has no parameter to hold and no saved fit to start from; leave --fix, --bound "
                "and --from out, or name another --structure"
            )
        theta = None
        if self.start is not None:
            self._check_rate(data)
            keeps_saved_model = with_parts and chain.structure == self.start.model.structure
            chain, theta = (
                (self.start.model, self.start.theta) if keeps_saved_model else started(chain, self.start, data)
            )
        fixed, bounds = dict(chain.fixed), dict(chain.bounds)
        fixed |= self._values(chain, theta)
        slots = dict(zip(chain.names, chain.slots, strict=True))
        for name, (low, high) in self.bounds:
            _check_name(chain, name, "--bound")
            slot = slots[name]
            bounds[name] = max(low, slot.lower), min(high, slot.upper)
            if not bounds[name][0] < bounds[name][1]:
                raise InputError(
                    f"--bound {name} is {low:g} to {high:g}; {name} lies between {slot.lower:g} and {slot.upper:g}: "
                    "give "
                    "bounds in there, the smaller first"
                )
        for name, value in fixed.items():
            low, high = bounds.get(name, (slots[name].lower, slots[name].upper))
            if not low <= value <= high:
                raise InputError(f"{name} is held at {value:g}, and it lies between {low:g} and {high:g}")
        chain = replace(chain, fixed=fixed, bounds=bounds)
        if not chain.free.any():
            raise InputError("every parameter is held, so nothing is left to fit; leave one --fix out")
        return chain, None if theta is None else clip_to_bounds(chain, theta)

    def _values(self, chain: Chain, theta: np.ndarray | None) -> dict[str, float]:
        """The held parameters by name."""
        values: dict[str, float] = {}
        for name, value in self.fixed:
            block = chain.block(name)
            if block is None:
                _check_name(chain, name, "--fix")
            elif value is not None:
                raise InputError(
                    f"--fix {name}={value:g} names a whole block; name a parameter: {_parameter_names(chain)}"
                )
            if value is not None:
                values[name] = value
                continue
            if theta is None:
                raise InputError(
                    f"--fix {name} has no value; give {_example(chain, name)}=VALUE, or a start with --from"
                )
            parameters = [name] if block is None else [f"{name}.{s.name}" for s in block.slots() if not s.initial]
            values |= {parameter: float(theta[chain.names.index(parameter)]) for parameter in parameters}
        return values

    def _check_rate(self, data: IOData) -> None:
        assert self.start is not None
        if not same_rate(self.start.Ts, data.Ts):
            raise InputError(
                f"--from {self.path} is a model sampled every {self.start.Ts:g} s and the record every {data.Ts:g} s; "
                f"give --resample {self.start.Ts:g}"
            )


def read_start(path: str) -> Fit:
    """The saved fit at `path`; raises InputError for a nonlinear ARX model, which cannot start a fit."""
    fit = load(path)
    if not isinstance(fit, Fit):
        raise InputError(f"{path}: a nonlinear ARX model cannot start a fit; give a model of blocks")
    return fit


def started(chain: Chain, start: Fit, data: IOData) -> tuple[Chain, np.ndarray]:
    """The chain on the scale of a saved fit, and its parameters (P,) that give the saved model.

    Raises InputError if the saved model has neither the same parameters nor the linear filter of this one.
    """
    saved_chain = start.model
    if saved_chain.structure == chain.structure and (
        saved_chain.asked == chain.blocks or _same_space(saved_chain, chain)
    ):
        return replace(saved_chain, fixed=chain.fixed, bounds=chain.bounds), start.theta
    linear = [block for block in chain.blocks if not isinstance(block, (StaticBlock, Channels))]
    if saved_chain.structure == "output_error" and len(linear) == 1 and saved_chain.blocks[0] == linear[0]:
        return chain, _straight_maps(chain, start, data)
    raise InputError(
        f"--from names a model of structure {saved_chain.structure} with {_orders(saved_chain)}, and the model to "
        "fit is of "
        f"{chain.structure} with {_orders(chain)}; give the orders and maps of the saved one, or none: a saved "
        "output_error starts structures that have its filter between static maps"
    )


def _same_space(saved_chain: Chain, chain: Chain) -> bool:
    """Whether both are state spaces of one size, which differ in the scale of their records."""
    return isinstance(saved_chain.blocks[0], StateSpace) and saved_chain.names == chain.names


def _straight_maps(chain: Chain, start: Fit, data: IOData) -> np.ndarray:
    """The saved linear block with its maps as straight lines over their signals, at the level of the saved model."""
    theta = np.zeros(len(chain.names))
    x, target, behind = data.u, data.u, False
    for k, block in enumerate(chain.blocks):
        is_filter = not isinstance(block, (StaticBlock, Channels))
        if is_filter:
            theta[chain.index(block)] = start.model.part(start.theta, start.model.blocks[0])
        else:
            start_maps(chain, theta, (block,), x, target)
        x = Chain(chain.blocks[: k + 1]).outputs(theta[: chain.index(block).stop], data.u)
        behind = behind or is_filter
        target = start.model.outputs(start.theta, data.u) if behind else x
    return theta


def settings_of(fit: Fit, kind: type[Recipe]) -> dict[str, Any]:
    """The settings of a recipe that a saved fit shows: of its own structure, else the orders of its filter."""
    chain, settings = fit.model, dict[str, Any]()
    orders = kind.of_kind("order")
    shared = chain.dynamics[0][1].orders if chain.dynamics and "nf2" not in orders else {}
    if set(shared) & set(orders) >= {"nb", "nf", "nk"}:
        settings = {name: value for name, value in shared.items() if name in orders}
    if kind.name != chain.structure:
        return settings
    space = chain.blocks[0]
    if isinstance(space, StateSpace) and "nx" in orders:
        settings = {"nx": space.nx, "units": space.units, "degree": space.degree, "spread": space.spread}
        settings["readout"] = "network" if space.readout else "linear"
    for field_name, role in (("input_map", "input"), ("output_map", "output")):
        if field_name in kind.options() and (name := _map_name(chain, role)):
            settings[field_name] = name
    if "offset" in kind.options() and chain.block("offset") is None and kind(**settings).model().block("offset"):
        settings["offset"] = "none"
    return settings


def _map_name(chain: Chain, role: str) -> str | None:
    block = chain.block(role)
    first = block.maps[0] if isinstance(block, Channels) else block
    return next((name for name, kind in STATIC.items() if type(first) is kind), None)


def _check_name(chain: Chain, name: str, option: str) -> None:
    if name not in chain.names:
        raise InputError(f"{option} names {name!r}, which the model does not have; it has {_parameter_names(chain)}")


def _parameter_names(chain: Chain) -> str:
    """The names of the parameters, block by block."""
    texts = []
    for block in chain.blocks:
        names = [f"{block.role}.{slot.name}" for slot in block.slots()]
        texts.append(", ".join(names[:MOST]) + (f", ... ({len(names)} of {block.role})" if len(names) > MOST else ""))
    return "; ".join(text for text in texts if text)


def _example(chain: Chain, name: str) -> str:
    block = chain.block(name)
    return name if block is None or not block.slots() else f"{name}.{block.slots()[0].name}"


def _orders(chain: Chain) -> str:
    filters = [f"{b.nb},{b.nf},{b.nk}" for _, b in chain.dynamics]
    return f"{len(chain.names)} parameters" + (f" and filters of nb,nf,nk {' and '.join(filters)}" if filters else "")


@dataclass(frozen=True)
class Setting:
    """The model and its fit: a recipe of `sysid.structures` with settings, a search, starts and seed, and what is
    `held` of it. After `seconds` the fit ends with the best so far. `knots` is that of `sysid.Objective`.

    Raises InputError for an unknown search or seconds that are not positive, before any work.
    """

    recipe: Recipe = field(default_factory=HammersteinWiener)
    search: str = "auto"
    starts: int = 5
    seed: int = 0
    held: Held = field(default_factory=Held)
    seconds: float = math.inf
    knots: int = Objective.knots

    def __post_init__(self) -> None:
        if self.search not in SEARCHES:
            raise unknown("search", self.search, SEARCHES)
        if not self.seconds > 0.0:
            raise InputError(f"seconds is {self.seconds:g}; give a positive number, or leave it out")
        Objective(knots=self.knots)  # raises

    def as_dict(self) -> dict[str, Any]:
        """The setting by option name; both maps are included, None for the default or if there is no such map."""
        return {
            "orders": self.recipe.orders,
            "structure": self.recipe.name,
            **dict.fromkeys(("input_map", "output_map")),
            **self.recipe.as_dict(),
            "search": self.search,
            "starts": self.starts,
            "seed": self.seed,
            **({"knots": self.knots} if self.knots != Objective.knots else {}),
            **self.held.as_dict(),
            **({"seconds": self.seconds} if self.seconds < math.inf else {}),
        }


def in_unit_of(record: Record, recipe: Recipe) -> tuple[Recipe, Record]:
    """The recipe with its settings in the record's unit, and the record with a note on which they are.

    A person gives them in the unit that the file's column names, for example degrees, which are read as radians.
    """
    unit = record.signals.mapping.output[0].unit
    factor = convert(unit).factor
    scaled_recipe = recipe.scaled(factor) if factor != 1.0 else recipe
    changed_names = [name for name, value in _numbers(recipe).items() if _numbers(scaled_recipe)[name] != value]
    if not changed_names:
        return recipe, record
    names = " and ".join(f"--{name.replace('_', '-')}" for name in changed_names)
    verb = "counts" if len(changed_names) == 1 else "count"
    note = f"{names} {verb} in the unit of column {record.output!r}, {unit}"
    return scaled_recipe, replace(record, remarks=(*record.remarks, note))


def _numbers(recipe: Recipe) -> dict[str, Any]:
    return {name: getattr(recipe, name) for name in recipe.of_kind("number")}
