"""A fit as the exporters take it: units with their code, wired from input to output, and the offsets of its levels."""

from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
from sysid.block.writing import Code
from sysid.estimation.free_run import resting_theta
from sysid.estimation.result import Fit
from sysid.export import network
from sysid.model.wiring import Layer, layers, offsets, written
from sysid.nlarx.result import NlarxFit

AnyFit = Fit | NlarxFit
Offset = float | np.ndarray | None


@dataclass(frozen=True)
class Wired:
    """Layers of units, the code of each unit by its name, and what is taken off u (nu,) and put on y (ny,)."""

    layers: tuple[Layer, ...]
    codes: dict[str, Code]
    u_offset: np.ndarray
    y_offset: np.ndarray


def wired(fit: AnyFit, way: str, u_offset: Offset = None, y_offset: Offset = None) -> Wired:
    """The fit in `way`, "c" or "python"; offsets are those of the fit unless others are given.

    Raises InputError for a block without a formula, and for numbers that are not finite.
    """
    u0, y0 = levels(fit, u_offset, y_offset)
    if isinstance(fit, NlarxFit):
        if not network.finite(fit):
            raise InputError("a parameter of this model is not finite; fit it again before writing it out")
        return Wired(network.wiring(fit), {network.NAME: network.code(fit, way)}, u0, y0)
    found = layers(fit.model, resting_theta(fit.model, fit.theta))  # the run of `Fit.simulate` for an input alone
    codes = {u.name: written(u, way)(u.theta) for layer in found for row in layer for u, _ in row}
    return Wired(found, codes, u0, y0)


def levels(fit: AnyFit, u_offset: Offset = None, y_offset: Offset = None) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (nu,) and (ny,): those given, else those of the fit, else zero."""
    n_in, n_out = channels(fit)
    own = (fit.u_offset, fit.y_offset)
    u0, y0 = (0.0 if o is None else o for o in own)
    return (
        offsets(u0 if u_offset is None else u_offset, n_in, "u_offset"),
        offsets(y0 if y_offset is None else y_offset, n_out, "y_offset"),
    )


def channels(fit: AnyFit) -> tuple[int, int]:
    """Number of inputs and of outputs."""
    return (1, 1) if isinstance(fit, NlarxFit) else fit.model.channels
