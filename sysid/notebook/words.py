"""Words for any fitted model: structure, orders, and the kind of every block."""

import re
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from sysid.base.quantities import display_quantity, number
from sysid.blocks import Channels, TransferFunction, TransferMatrix
from sysid.estimation.result import Fit
from sysid.model.recipes import Option, Recipe
from sysid.nlarx.result import NlarxFit
from sysid.structures import TABLE


@dataclass(frozen=True)
class Given(Recipe):
    """The recipe of a model that exists already: words for a page, and no settings.

    `of` is the structure's name, whose physical values a page may show.
    """

    name: ClassVar[str] = "given"
    words: str = ""
    of: str = ""

    @classmethod
    def options(cls) -> dict[str, Option]:
        return {}

    def model(self) -> None:
        """There is nothing to build."""

    def in_words(self, fit: Any = None) -> str:
        return self.words

    def as_subject(self, fit: Any = None) -> str:
        return f"{'An' if self.words[:1] in 'AEIOU' or self.words.startswith('NLARX') else 'A'} {self.words} model"

    def physics(self) -> dict[str, Any] | None:
        return TABLE[self.of]().physics() if self.of in TABLE else None


def recipe_of(fit: Fit | NlarxFit) -> Given:
    """What a page needs to know of a model."""
    return Given(structure_in_words(fit), fit.model.structure)


def structure_in_words(fit: Fit | NlarxFit) -> str:
    """Structure, orders and blocks in one phrase."""
    if isinstance(fit, NlarxFit):
        m = fit.model
        return f"NLARX (na {m.na}, nb {m.nb}, nk {m.nk}), wavelet network of {fit.network.units} units"
    name = fit.model.structure.replace("_", "-").title()
    return ", ".join([f"{name}{orders(fit)}", *_others(fit)])


def orders(fit: Fit) -> str:
    """The orders of a single transfer function in brackets, else nothing."""
    found = [b for b in fit.model.blocks if isinstance(b, TransferFunction)]
    if len(found) != 1:
        return ""
    return f" (nb {found[0].nb}, nf {found[0].nf}, nk {found[0].nk})"


def _others(fit: Fit) -> list[str]:
    """The other blocks by role."""
    several = sum(isinstance(b, TransferFunction) for b in fit.model.blocks) > 1
    found = []
    for b in fit.model.blocks:
        if isinstance(b, TransferMatrix):
            found.append(f"{b.channels[1]} x {b.channels[0]} transfer functions")
        elif isinstance(b, TransferFunction):
            found += [f"{b.role} (nb {b.nb}, nf {b.nf}, nk {b.nk})"] if several else []
        else:
            kinds = dict.fromkeys(_kind(m) for m in b.maps) if isinstance(b, Channels) else [_kind(b)]
            role = b.role.replace("_", " ")
            kind = "/".join(kinds)
            found.append(kind if role in kind.split() else f"{role} {kind}")
    return found


def _kind(block: Any) -> str:
    """PiecewiseLinear as piecewise linear."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", type(block).__name__).lower()


def rmse_in_words(fit: Fit | NlarxFit) -> str:
    """The root of the mean squared error in the unit in which people read the output."""
    data = fit.record
    q = display_quantity("", data.y_unit if data is not None else "")
    return f"{number(float(np.sqrt(fit.criteria.mse)) * q.factor)} {q.unit}".rstrip()


def criteria_in_words(fit: Fit | NlarxFit) -> str:
    """The criteria that compare models, and what they count."""
    c = fit.criteria
    return f"FPE {number(c.fpe)}, AICc {number(c.aicc, 6)}, BIC {number(c.bic, 6)}, d {c.d} of {c.N} samples"


def search_in_words(fit: Fit | NlarxFit) -> str:
    """How the search ended, and its effort."""
    return f"{fit.search}: {fit.stop.reason} ({fit.stop.iterations} iterations, {fit.seconds:.2g} s)"
