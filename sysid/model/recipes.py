"""What a recipe of models is: the settings of one structure and all that follows from them; and blocks by name."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import numpy as np

from sysid.base.checks import short_text
from sysid.base.errors import InputError, unknown
from sysid.block.block import Block, StaticBlock
from sysid.blocks import STATIC, Channels, Offset, TransferFunction, TransferMatrix, static
from sysid.data.preprocess import retrend
from sysid.data.record import IOData

Map = str | StaticBlock
OFFSETS = ("free", "each", "none")  # "each": one for every experiment
Order = int | Sequence[Sequence[int]]


@dataclass(frozen=True)
class Option:
    """What people read of a setting.

    kind: "order", "map", "name" or "number"; help: for a command line; word: what the report calls a map; allowed:
    names that it may have; unit: of a number; least: the smallest order.
    """

    kind: str
    help: str
    word: str = ""
    allowed: tuple[str, ...] = ()
    unit: str = ""
    least: int = 0


def order(default: int, help: str, least: int = 0) -> Any:
    """A field that is an order of the model."""
    return field(default=default, metadata={"option": Option("order", help, least=least)})


def static_map(word: str, help: str) -> Any:
    """A field that names a static map; None is the structure's own default."""
    return field(default=None, metadata={"option": Option("map", help, word, tuple(STATIC))})


def choice(default: str, help: str, allowed: Sequence[str]) -> Any:
    """A field that is one of several names."""
    return field(default=default, metadata={"option": Option("name", help, allowed=tuple(allowed))})


def zero_of_output() -> Any:
    """A field that says whether the zero of the output is a parameter, see `with_offset`."""
    words = "offset of the output: a parameter where no map holds it already, one for each log, or none"
    return choice("free", words, OFFSETS)


def number(default: float | None, help: str, unit: str) -> Any:
    """A field that is a number."""
    return field(default=default, metadata={"option": Option("number", help, unit=unit)})


@dataclass(frozen=True)
class Recipe(ABC):
    """Settings of one structure of one input and one output, or of several (`Several`); fields are made by `order`,
    `static_map`, `choice` and `number`, and command line, summary, report and structure search read them from here.

    name: by which `sysid.structures.TABLE` has it; called: what a text calls it instead. searched: whether structure
    search tries it, and rungs: the settings that it tries first; none means every order of the search space, with every
    combination of maps around the best linear orders, and the defaults where the orders are not nb, nf, nk. `ladder`
    and `neighbours` say the same of a record and of one setting. least_starts: of a search that must find its optimum.
    with_parts: whether it is fitted by `sysid.fit_joint` instead of `sysid.fit`. auto: the search that "auto" means.
    zero: what of its record counts from zero, so that no means may be removed. moves: whether its output is the place
    of what a voltage moves, so that the command integrates a speed. Raises InputError for settings that give no model,
    before any work.
    """

    name: ClassVar[str]
    called: ClassVar[str] = ""
    searched: ClassVar[bool] = False
    rungs: ClassVar[tuple[dict[str, Any], ...]] = ()
    least_starts: ClassVar[int] = 1
    with_parts: ClassVar[bool] = False
    auto: ClassVar[str] = "auto"
    zero: ClassVar[str] = ""
    moves: ClassVar[bool] = False

    def __post_init__(self) -> None:
        self.model()

    @abstractmethod
    def model(self) -> Any:
        """The Chain or Nlarx to fit; of a structure with parts, what it begins with."""

    def model_of(self, data: IOData) -> Any:
        """The model to fit to a record: `model()` with what the settings leave to its units and its sampling time."""
        return self.model()

    def blocks_to_compile(self) -> tuple[Block, ...]:
        """Blocks whose loops a fit surely runs, those that compile long first; none where no block does."""
        blocks = sorted(getattr(self.model(), "blocks", ()), key=lambda block: not block.compiles_long)
        return tuple(blocks) if blocks and blocks[0].compiles_long else ()

    def scaled(self, y: float) -> "Recipe":
        """The same where settings are in a unit of the output that is `y` times the record's, as a file's degrees are.

        Settings in its inverse, such as gains, change the other way.
        """
        values = {name: getattr(self, name) for name in self.of_kind("number")}
        powers = {name: _power_of_y(self.options()[name].unit) for name in values}
        changed = {name: value * y ** powers[name] for name, value in values.items() if value is not None}
        return replace(self, **{name: changed[name] for name in changed if powers[name]})

    @classmethod
    def options(cls) -> dict[str, Option]:
        """What people read of every setting, by field."""
        return {f.name: f.metadata["option"] for f in fields(cls)}

    @classmethod
    def of_kind(cls, kind: str) -> tuple[str, ...]:
        """Names of the fields of one kind."""
        return tuple(name for name, option in cls.options().items() if option.kind == kind)

    @classmethod
    def ladder(cls, data: IOData) -> "tuple[Recipe, ...]":
        """What a structure search tries first on a record, which is on the scale of this structure."""
        return tuple(cls(**rung) for rung in cls.rungs or ({},))

    def neighbours(self) -> "tuple[Recipe, ...]":
        """The same with one order more or less; a structure search tries them around its best candidates."""
        steps = [{name: step} for name in self.orders for step in (1, -1)]
        return tuple(recipe for step in steps if (recipe := self.stepped(**step)) is not None)

    def parts(self, Ts: float) -> "dict[str, tuple[float, tuple[Recipe, ...]]]":
        """By the words of a value that a part of the model has: its least value, and the same without such parts."""
        return {}

    @property
    def swings(self) -> bool:
        """Whether it may swing where another of as many parameters cannot."""
        return False

    def stepped(self, **steps: int) -> "Recipe | None":
        """The same with its orders changed by `steps`; None below the least order."""
        orders = {name: self.orders[name] + step for name, step in steps.items()}
        if any(value < self.options()[name].least for name, value in orders.items()):
            return None
        return replace(self, **orders)

    @property
    def orders(self) -> dict[str, int]:
        """The orders by name, in the order in which people give them."""
        return {name: getattr(self, name) for name in self.of_kind("order")}

    @property
    def maps(self) -> dict[str, str]:
        """The maps that are named, by field."""
        return {name: value for name in self.of_kind("map") if (value := getattr(self, name)) is not None}

    def as_dict(self) -> dict[str, Any]:
        """Every setting that is not an order, by field."""
        return {name: getattr(self, name) for name, option in self.options().items() if option.kind != "order"}

    @property
    def order_text(self) -> str:
        """The orders as a table shows them, "(2,3,1)"; empty where there are none."""
        return f"({','.join(map(str, self.orders.values()))})" if self.orders else ""

    @property
    def short(self) -> str:
        """Structure and orders as a table shows them."""
        return f"{self.name.replace('_', '-')} {self.order_text}".rstrip()

    def __str__(self) -> str:
        return " ".join(part for part in (self.name, self.order_text, "/".join(self.maps.values())) if part)

    def in_words(self, fit: Any = None) -> str:
        """Structure, orders and maps in one phrase; `fit` may add what the fit chose."""
        orders = ", ".join(f"{name} {value}" for name, value in self.orders.items())
        return ", ".join([f"{self.title()} ({orders})", *self.maps_in_words()])

    @classmethod
    def title(cls) -> str:
        """The structure as a text calls it."""
        return cls.called or cls.name.replace("_", "-").title()

    def maps_in_words(self) -> list[str]:
        """One phrase for each map that is named."""
        return [f"{self.options()[name].word} {value.replace('_', ' ')}" for name, value in self.maps.items()]

    def as_subject(self, fit: Any = None) -> str:
        """The same as the subject of a sentence."""
        words = self.in_words(fit)
        return f"{'An' if words[0] in 'AEIOU' else 'A'} {words} model"

    @classmethod
    def detrend(cls, asked: str | None = None) -> str:
        """What is removed from a record before a fit: what was asked for, else nothing.

        Raises InputError where something else than "none" is asked for and signals count from zero.
        """
        if cls.zero and asked and asked != "none":
            raise InputError(
                f"detrend is {asked!r}, and {cls.zero} of structure {cls.name} count from zero; "
                "leave it out or give none"
            )
        return asked or "none"

    def scale(self, data: IOData) -> IOData:
        """The record on the scale that this structure needs: with its means back where signals count from zero."""
        return retrend(data) if self.zero else data

    def physics(self) -> dict[str, Any] | None:
        """Options of `sysid.joint_values` where the parameters are physical values, else None."""
        return None


class Several(Recipe):
    """A recipe whose structure takes several inputs and outputs: as many as the record has."""

    @abstractmethod
    def model(self, nu: int = 1, ny: int = 1) -> Any:
        """The Chain to fit to a record of nu inputs and ny outputs."""

    def model_of(self, data: IOData) -> Any:
        """The model with the channels of the record."""
        return self.model(data.u.shape[1], data.y.shape[1])


@dataclass(frozen=True)
class LinearOrders(Recipe):
    """A recipe around B/F of orders nb, nf and nk."""

    nb: int = order(2, "zeros + 1", least=1)
    nf: int = order(3, "poles")
    nk: int = order(1, "delay in samples")

    def neighbours(self) -> tuple[Recipe, ...]:
        """One zero, pole or both more or less, the delay off by one, and a coefficient of B replaced by a delay."""
        steps = [(1, 0, 0), (0, 1, 0), (1, 1, 0), (-1, 0, 0), (0, -1, 0), (-1, -1, 0)]
        steps += [(0, 0, 1), (0, 0, -1), (-1, 0, 1), (1, 0, -1)]
        found = (self.stepped(nb=nb, nf=nf, nk=nk) for nb, nf, nk in steps)
        return tuple(recipe for recipe in found if recipe is not None)


def _power_of_y(unit: str) -> int:
    """1 of a setting in the unit of the output, -1 of one in its inverse, else 0."""
    above, _, below = unit.partition("/")
    return int("Y" in above) - int("Y" in below)


def named(**maps: str | None) -> dict[str, Any]:
    """The maps that are named; the others are a structure's own defaults."""
    return {role: name for role, name in maps.items() if name is not None}


def maps(kind: Map | Sequence[Map], role: str, channels: int) -> Block:
    """One static map, or one for each of several channels; a sequence names one for each channel."""
    if channels == 1 and isinstance(kind, (str, StaticBlock)):
        return static(kind, role)
    kinds = [kind] * channels if isinstance(kind, (str, StaticBlock)) else list(kind)
    if len(kinds) != channels:
        raise InputError(f"{len(kinds)} {role} maps for {channels} channel(s); give one name, or one for each channel")
    return Channels(maps=tuple(static(k, role) for k in kinds), role=role)


def with_offset(blocks: Sequence[Block], ny: int, offset: str) -> tuple[Block, ...]:
    """The blocks of a chain, with the offsets of ny outputs behind them.

    Of "free" ones where no map holds them; "each" gives every experiment its own.
    """
    if offset not in OFFSETS:
        raise unknown("offset", offset, OFFSETS)
    if offset == "none" or (offset == "free" and hold_offset(blocks)):
        return tuple(blocks)
    return (*blocks, maps(Offset(each=offset == "each"), "offset", ny))


def offset_of_input(offset: str) -> tuple[Block, ...]:
    """The constant before a chain without maps if `offset` is "free", for every experiment if it is "each"."""
    if offset not in OFFSETS:
        raise unknown("offset", offset, OFFSETS)
    return () if offset == "none" else (Offset(role="offset", each=offset == "each"),)


def hold_offset(blocks: Sequence[Block]) -> bool:
    """Whether a map holds any offset of each output: one that moves its output while its input stays.

    From the end on, a saturation whose limits move and a filter of one channel pass what a map before them holds.
    """
    for block in reversed(blocks):
        parts = [part for _, part in block.parts()]
        if all(isinstance(part, StaticBlock) for part in parts):
            moves = [part.symmetries(part.start(np.linspace(-1.0, 1.0, 50))) for part in parts]
            if all(any(s.out_shift and not s.in_shift for s in part) for part in moves):
                return True
            if not all(any(s.out_shift and s.in_shift for s in part) for part in moves):
                return False
        if block.channels != (1, 1):
            return False
    return False


def filters(nb: Order, nf: Order, nk: Order, nu: int, ny: int, role: str = "linear") -> Block:
    """B/F, or an ny x nu matrix of them; each order is one number for all or rows [output][input]."""
    if nu < 1 or ny < 1:
        raise InputError(f"nu and ny are {nu} and {ny}; give at least 1 of each")
    if (nu, ny) == (1, 1) and all(isinstance(k, (int, np.integer)) for k in (nb, nf, nk)):
        return TransferFunction(nb, nf, nk, role=role)  # type: ignore[arg-type]
    tables = []
    for name, order in (("nb", nb), ("nf", nf), ("nk", nk)):
        try:
            table = np.asarray(order)
        except ValueError:  # rows of several lengths
            table = np.empty(0)
        table = np.broadcast_to(table, (ny, nu)) if table.ndim == 0 else table
        if table.shape != (ny, nu) or table.dtype.kind not in "iu":
            raise InputError(f"{name} is {order!r}; give one integer or {ny} rows of {nu}, [output][input]")
        tables.append(table)
    B, F, K = tables
    rows = [tuple(TransferFunction(int(B[j, i]), int(F[j, i]), int(K[j, i])) for i in range(nu)) for j in range(ny)]
    return TransferMatrix(entries=tuple(rows), role=role)


def beside(own: dict[str, float], given: Any) -> dict[str, Any]:
    """The `fixed` of a chain: what its structure fixes, and what its caller does, by parameter."""
    if given is not None and not isinstance(given, Mapping):
        raise InputError(f"fixed is {short_text(given)}; give a dict")
    return {**own, **(given or {})}
