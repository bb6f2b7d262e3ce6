"""What every fit knows of its record, and does with rooms above its own: figures, a page, linear views."""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.handlers import Shown, handler
from sysid.base.quantities import SHARE
from sysid.base.rates import same_rate
from sysid.data.record import IOData
from sysid.model.chain import Chain

ONE_STEP, FREE_RUN = "one step ahead", "free run"

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Origin:
    """Names and units of the estimation data, its number of samples, and the fit [%] of the free run there.

    `inputs` and `outputs` are the columns of the file that the data came from, () where they came from none.
    """

    u_name: str
    y_name: str
    u_unit: str
    y_unit: str
    samples: int
    fit: float
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    @classmethod
    def of(cls, data: IOData, fit: float) -> "Origin":
        """Of a fit to `data` whose free run has this fit [%]."""
        return cls(data.u_name, data.y_name, data.u_unit, data.y_unit, data.N, float(fit))

    @property
    def si_units(self) -> tuple[str, str]:
        """Units of the numbers of input and output as code takes and gives them: a share is a part of 1."""
        u, y = ("1" if unit == SHARE else unit for unit in (self.u_unit, self.y_unit))
        return u, y

    def other_unit(self, data: IOData) -> tuple[str, str, str] | None:
        """The first of "input" and "output" whose stated unit is another: its name, its unit, and the unit here."""
        for role, unit, model_unit in (("input", data.u_unit, self.u_unit), ("output", data.y_unit, self.y_unit)):
            if _plain(model_unit) and _plain(unit) and _plain(model_unit) != _plain(unit):
                return role, unit, model_unit
        return None


_SPELLED = str.maketrans({"°": "deg", "º": "deg", "µ": "u", "μ": "u", **dict.fromkeys(" *·.?-", None)})


def _plain(unit: str) -> str:
    """A unit without what spells it differently: N*m, N m and Nm are one, a share is a number; nothing for a dash."""
    return "1" if unit == SHARE else unit.translate(_SPELLED)


def check_units(data: IOData, origin: Origin | None) -> None:
    """Raises InputError for a record that states other units than those of a fit's record."""
    mismatch = None if origin is None else origin.other_unit(data)
    if mismatch is not None:
        role, unit, model_unit = mismatch
        raise InputError(
            f"the {role} of the record is in {unit} and the model's in {model_unit}; convert the record, or correct "
            f"the unit with dataclasses.replace(data, {'u' if role == 'input' else 'y'}_unit={model_unit!r})"
        )


def check_same_kind(data: IOData, Ts: float, origin: Origin | None) -> None:
    """Raises InputError for a record of another sampling time [s] or other units than a model's."""
    if not same_rate(data.Ts, Ts):
        raise InputError(f"the record is sampled every {data.Ts} s and the model every {Ts} s; resample it first")
    check_units(data, origin)


def check_channels(model: Chain, data: IOData) -> None:
    """Raises InputError if a record differs from the model in the number of inputs or outputs."""
    channels, (nu, ny) = (data.u.shape[1], data.y.shape[1]), model.channels
    if channels != (nu, ny):
        raise InputError(
            f"the record has {channels[0]} input(s) and {channels[1]} output(s), the model {nu} and {ny}; choose "
            "one column of each or build the model with nu and ny"
        )


def share_explained(data: IOData, mse: float) -> float:
    """Fit [%] of errors with this mean square: of one output, or of all outputs together."""
    observed = data.observed
    y = [column[mask] for column, mask in zip(data.y.T, observed.T, strict=True)]
    size = sum(float(np.sum((part - part.mean()) ** 2)) for part in y)
    return 100.0 * (1.0 - float(np.sqrt(mse * observed.sum() / size))) if size > 0 else float("-inf")


class FitMethods(Shown):
    """Methods that a chain's fit and a nonlinear ARX fit have in common.

    `data` may be left out where the fit knows its record (`record`): then it is the record of the fit. A fit that was
    read from a file has none, and each method raises InputError without `data`.
    """

    @property
    def record(self) -> IOData | None:
        """The record of the fit; None for one that was read from a file."""
        return self.__dict__.get("_record")

    def remember(self, data: IOData) -> Self:
        """The same result, which knows its record from now on; raises InputError for anything but a record."""
        if not isinstance(data, IOData):
            raise InputError(f"data is a {type(data).__name__}; give the record of the fit, an IOData")
        self.__dict__["_record"] = data
        return self

    def record_or(self, data: IOData | None) -> IOData:
        """`data`, or the record of the fit where that is None; raises InputError if there is none."""
        record = self.record if data is None else data
        if record is None:
            raise InputError(
                "this fit was read from a file and has no record; give one as data=, for example fit.plot(data) or "
                "fit.report(path, data=data)"
            )
        return record

    @checked
    def plot(self, data: IOData | None = None, what: str = "output", at: float | None = None) -> "Figure":
        """A figure: "output" (free run and error), "residuals", "poles", "bode", "step" or "maps".

        Bands are 95 % intervals from the information of `data`, which must be the record of the fit for them; they
        allow for coloured residuals. `at` is the constant input [unit of u, counted as in `data`] of the tangent that
        "bode" and "step" show, by default 0, or the middle of the input's range where that does not hold 0. The output
        is drawn at the record's own level: what detrending removed is added again. The figure is pyplot's where
        matplotlib.pyplot is loaded. Raises InputError for another name, for a figure that this kind of model has not,
        and for `at` in a figure that has no operating point.
        """
        figure: Figure = handler(self).plot(self, data, what, at)
        return figure

    @checked
    def report(self, path: str | PathLike, data: IOData | None = None, validation: IOData | None = None) -> Path:
        """Write the page of `qpal identify` for this fit to `path`, one HTML file, and return that path.

        `data` is the record of the fit, `validation` one that the fit has not seen; without it the page scores the
        record of the fit itself and says so. Raises InputError for several inputs or outputs and for a folder that is
        not there.
        """
        page: Path = handler(self).report(self, path, data, validation)
        return page

    @checked
    def refine(self, data: IOData | None = None, **options: Any) -> Self:
        """The same model, searched further from this fit; `options` are those of `sysid.fit`, for example search="lm".

        On its own record the mean square error (`criteria.mse`) does not rise: where the search ends higher, the result
        is this fit with a warning. With an `objective` of your own its cost counts, penalties included, and the error
        may rise. Raises InputError for a nonlinear ARX model, which takes no start.
        """
        fit: Self = handler(self).refine(self, data, **options)
        return fit

    @checked
    def noise_model(self, data: IOData | None = None) -> Any:
        """The colour of the residuals as an autoregression, see `sysid.linear.noise.Noise`."""
        return handler(self).noise_model(self, data)

    @checked
    def modes(self, data: IOData | None = None) -> Any:
        """Poles with natural frequency, damping and time constant, and standard deviations (`sysid.linear.modes`)."""
        return handler(self).modes(self, data)
