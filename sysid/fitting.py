"""`sysid.fit`, `save` and `load`: one function for every kind of model."""

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any, overload

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.data.frequency import FrequencyData
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.frequency_fit import ResponseFit, fit_response
from sysid.estimation.objective import Objective
from sysid.estimation.result import Fit
from sysid.model.chain import Chain
from sysid.nlarx.fit import fit_nlarx
from sysid.nlarx.model import Nlarx
from sysid.nlarx.result import NlarxFit
from sysid.solver.iterate import Options


@checked
def load(path: str | PathLike) -> Fit | NlarxFit:
    """Read a fit that its `save` wrote, a chain's or a nonlinear ARX model's; raises InputError for anything else."""
    from sysid.estimation.storage import FORMAT, build_fit, read
    from sysid.nlarx import result, storage

    formats: dict[str, Callable[[dict[str, Any]], Fit | NlarxFit]] = {
        FORMAT: build_fit,
        result.FORMAT: storage.build_fit,
    }
    return read(path, formats)


@checked
def save(fit: Fit | NlarxFit, path: str | PathLike) -> Path:
    """Write a fit of either kind as readable JSON; `load` reads it again, `qpal run` and `qpal export` take it.

    Raises InputError for a model that text cannot store or a path that cannot be written.
    """
    return fit.save(path)


@overload
def fit(model: Nlarx, data: IOData, *args: Any, **kwargs: Any) -> NlarxFit: ...


@overload
def fit(model: Chain, data: FrequencyData, *args: Any, **kwargs: Any) -> ResponseFit: ...


@overload
def fit(model: Chain, data: IOData, *args: Any, **kwargs: Any) -> Fit: ...


@checked(deferred=("start",))
def fit(
    model: Chain | Nlarx,
    data: IOData | FrequencyData,
    search: str = "auto",
    starts: int | str = "auto",
    seed: int = 0,
    options: Options | None = None,
    start: "np.ndarray | Fit | None" = None,
    objective: Objective | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fit | NlarxFit | ResponseFit:
    """Fit a chain to a record of one or several merged experiments by least squares on its free-run output.

    search: a name of `sysid.solver.searches.TABLE`; starts: "auto", which goes on until two independent starts agree
    (`Fit.agreed`) or six rounds are over, or how many starting points; `seed` draws them; start (P,) or (K, P): one
    or several starting points to use instead, or a fit of the same model; objective: Huber's threshold, ridge, output
    weights, and the curvature weight that prevents kinks of free maps without data (on by default: `Objective`). Equal
    seeds give equal numbers for any number of threads. Raises InputError for a record that is too short, has other
    channels than the model, or has a constant input or output. For an Nlarx, `sysid.fit_nlarx` does the fit.
    `sysid.data.frequency_data` takes a frequency response in place of a record; a `process` is fitted to it, or with a
    sampling time an `output_error`, by the squares of the complex errors.
    """
    if isinstance(data, FrequencyData):
        if isinstance(model, Nlarx) or objective is not None:
            raise InputError("frequency data are fitted by process and output_error, and without an objective")
        return fit_response(model, data, search, options, start)
    if isinstance(model, Nlarx):
        if start is not None or objective is not None:
            raise InputError("a nonlinear ARX model takes no start and no objective; leave them out or see fit_nlarx")
        count = 5 if isinstance(starts, str) else starts
        network = fit_nlarx(model, data, search=search, starts=count, seed=seed, options=options, progress=progress)
        return network.remember(data)
    return fit_chain(model, data, search, starts, seed, options, start, objective, progress).remember(data)
