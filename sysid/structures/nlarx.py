"""Nonlinear ARX: a nonlinear function of past outputs and inputs."""

from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.model.recipes import Recipe, choice, order
from sysid.nlarx.model import FOCUS, Nlarx


@checked(deferred=("na", "nb", "nk", "units"))
def nlarx(
    na: int = 2,
    nb: int = 2,
    nk: int = 1,
    units: int | str = "auto",
    focus: str = "prediction",
    nonlinear: tuple[str, ...] | None = None,
) -> Nlarx:
    """y(t) = L phi + wavelet network(phi), phi = y(t-1)..y(t-na), u(t-nk)..u(t-nk-nb+1).

    units: number of wavelets and scaling functions, 0 for a linear ARX; 'auto' uses generalised cross-validation.
    focus: 'prediction' fits the one-step-ahead prediction (fast, but the free run may drift or diverge), 'simulation'
    fits the free run. nonlinear: the regressors of the network ('y1' is y(t-1)), all if None, none if (); the linear
    part has all.
    """
    return Nlarx(na, nb, nk, units, focus, nonlinear)


@checked
@dataclass(frozen=True)
class NonlinearArx(Recipe):
    """Settings of `nlarx` with an automatic network size."""

    name: ClassVar[str] = "nlarx"
    searched: ClassVar[bool] = True
    rungs: ClassVar = ({"focus": "simulation"}, {"na": 1, "nb": 1, "focus": "simulation"})
    na: int = order(2, "past outputs")
    nb: int = order(2, "past inputs", least=1)
    nk: int = order(1, "delay in samples")
    focus: str = choice("prediction", "prediction or simulation errors minimised by nlarx", FOCUS)

    def model(self) -> Nlarx:
        return nlarx(self.na, self.nb, self.nk, focus=self.focus)

    def in_words(self, fit: Any = None) -> str:
        orders = ", ".join(f"{name} {value}" for name, value in self.orders.items())
        size = f" of {fit.network.units} units" if fit is not None else ""
        return f"NLARX ({orders}) with a wavelet network{size}"

    def as_subject(self, fit: Any = None) -> str:
        return f"An {self.in_words(fit)}"
