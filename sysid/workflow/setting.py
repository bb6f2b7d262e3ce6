"""Setting: the model to fit, and how."""

import math
from dataclasses import dataclass, field
from typing import Any

from sysid.base.errors import InputError, unknown
from sysid.solver.searches import TABLE as SEARCHES
from sysid.structures import HammersteinWiener, Recipe
from sysid.workflow.held import Held


@dataclass(frozen=True)
class Setting:
    """The model and its fit: a recipe of `sysid.structures` with settings, a search, starts and seed, and what is
    `held` of it. After `seconds` the fit ends with the best so far.

    Raises InputError for an unknown search or seconds that are not positive, before any work.
    """

    recipe: Recipe = field(default_factory=HammersteinWiener)
    search: str = "auto"
    starts: int = 5
    seed: int = 0
    held: Held = field(default_factory=Held)
    seconds: float = math.inf

    def __post_init__(self) -> None:
        if self.search not in SEARCHES:
            raise unknown("search", self.search, SEARCHES)
        if not self.seconds > 0.0:
            raise InputError(f"seconds is {self.seconds:g}; give a positive number, or leave it out")

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
            **self.held.as_dict(),
            **({"seconds": self.seconds} if self.seconds < math.inf else {}),
        }
