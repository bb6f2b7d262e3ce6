"""Nonlinear ARX: a function of past outputs and inputs."""

from sysid.nlarx.model import Nlarx


def nlarx(
    na: int = 2,
    nb: int = 2,
    nk: int = 1,
    units: int | str = "auto",
    focus: str = "prediction",
    nonlinear: tuple[str, ...] | None = None,
) -> Nlarx:
    """y(t) = L phi + wavelet network(phi), phi = y(t-1)..y(t-na), u(t-nk)..u(t-nk-nb+1).

    units: how many wavelets and scaling functions, 0 for a linear ARX, 'auto' lets generalised cross-validation decide.
    focus: 'prediction' fits one step ahead (fast; its free run may drift or diverge), 'simulation' the free run.
    nonlinear: the regressors that enter the network ('y1' is y(t-1)), all where None, none where (); the line has all.
    """
    return Nlarx(na, nb, nk, units, focus, nonlinear)
