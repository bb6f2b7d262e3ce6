"""What a structure search tries first, and what it tries around a candidate."""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.data.record import IOData
from sysid.model.chain import Chain
from sysid.model.recipes import Recipe
from sysid.structures import TABLE, OutputError

ORDERS = ("nb", "nf", "nk")
MAPS = ("unit_gain", "saturation", "dead_zone", "piecewise_linear")


@checked(late=True)
@dataclass(frozen=True)
class Space:
    """What a search tries first: every combination of nb, nf, nk, and of the maps that a structure has.

    structures: names in `sysid.structures.TABLE`; none means all that declare that they are searched. starts: of the
    fits that decide. grows: whether the search goes on past these orders and maps, around its best candidates.
    """

    nb: tuple[int, ...] = (1, 2, 3)
    nf: tuple[int, ...] = (1, 2, 3)
    nk: tuple[int, ...] = (0, 1, 2, 3)
    input: tuple[str, ...] = MAPS
    output: tuple[str, ...] = MAPS
    kept_orders: int = 3
    starts: int = 5
    structures: tuple[str, ...] = ()
    grows: bool = True

    def __post_init__(self) -> None:
        for name in ("nb", "nf", "nk", "input", "output"):
            if not getattr(self, name):
                raise InputError(f"the search space has no {name}; name at least one")
        for name in self.structures:
            if name not in TABLE:
                raise unknown("structure", name, TABLE)

    @property
    def kinds(self) -> list[type[Recipe]]:
        """The structures of this search."""
        return [TABLE[name] for name in self.structures] or [kind for kind in TABLE.values() if kind.searched]

    def grid(self) -> list[Recipe]:
        """Linear models of every order, which cost little and show the orders that the others begin with.

        No model has more zeros than a sampled plant of that many poles.
        """
        every = itertools.product(self.nb, self.nf, self.nk)
        return [OutputError(nb, nf, nk, offset="free") for nb, nf, nk in every if nb <= nf + 1]

    def ladders(self, data: IOData) -> list[Recipe]:
        """The first candidates of every structure that is not tried around linear orders: one of each, then more."""
        ladders = [kind.ladder(kind().scale(data)) for kind in self.kinds if not _around_orders(kind)]
        return [c for rung in itertools.zip_longest(*ladders) for c in rung if c is not None]

    def tasters(self, data: IOData) -> list[Recipe]:
        """One candidate of every structure: what even a short budget looks at, those that cost little first.

        Its defaults where the space has them; around linear orders the last of its maps, which bends most freely.
        """
        grid = self.grid()
        linear = next((c for c in grid if c.orders == OutputError().orders), grid[-1] if grid else None)
        map_candidates = [] if linear is None else self.around([linear.orders])
        candidates: list[Recipe] = []
        for kind in self.kinds:
            if kind is OutputError:
                candidates += [linear] if linear is not None else []
            elif _around_orders(kind):
                candidates += [c for c in map_candidates if type(c) is kind][-1:]
            else:
                ladder = kind.ladder(kind().scale(data))
                candidates.append(kind() if kind() in ladder else ladder[0])
        return sorted(candidates, key=_cost)

    def around(self, orders: list[dict[str, int]]) -> list[Recipe]:
        """Every pair of maps at every order, as the structure that has exactly these maps."""
        candidates = []
        for o, first, last in itertools.product(orders, self.input, self.output):
            maps = {name: m for name, m in (("input_map", first), ("output_map", last)) if m != "unit_gain"}
            kinds = [k for k in self.kinds if _around_orders(k) and maps and set(k.of_kind("map")) == set(maps)]
            candidates += [kind(**o, **maps) for kind in kinds]
        return candidates

    def beside(self, c: Recipe) -> list[Recipe]:
        """The neighbours of a candidate, and the same with one of its named maps exchanged."""
        if not self.grows:
            return []
        allowed = {name: option.allowed for name, option in c.options().items()}
        maps = [
            replace(c, **{name: map_name})
            for name, current in c.maps.items()
            for map_name in allowed[name]
            if map_name not in (current, "unit_gain")
        ]
        return [*c.neighbours(), *maps]


def _cost(c: Recipe) -> tuple[bool, float]:
    """What grows with the time of a fit: searches for parts, and the number of parameters; that of an NLARX model is
    known only when its regressors and units are chosen, which takes longer than a fit of any map.
    """
    model = c.model()
    return c.with_parts, float(model.free.sum()) if isinstance(model, Chain) else np.inf


def _around_orders(kind: type[Recipe]) -> bool:
    """Whether a structure is tried around the orders of linear models: it has these orders and no rungs of its own."""
    return kind.of_kind("order") == ORDERS and not kind.rungs and kind.searched
