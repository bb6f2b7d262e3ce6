"""What every fit does with rooms above its own: figures, a page, a further search, linear views, a noise model."""

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from sysid.base.checks import checked
from sysid.base.handlers import Shown, handler
from sysid.data.record import IOData
from sysid.data.remembered import Remembered

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class FitMethods(Shown, Remembered):
    """Methods that a chain's fit and a nonlinear ARX fit have in common.

    `data` may be left out where the fit knows its record (`record`): then it is the record of the fit. A fit that was
    read from a file has none, and each method raises InputError without `data`.
    """

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
        found: Path = handler(self).report(self, path, data, validation)
        return found

    @checked
    def refine(self, data: IOData | None = None, **options: Any) -> Self:
        """The same model, searched further from this fit; `options` are those of `sysid.fit`, for example search="lm".

        On its own record the mean square error (`criteria.mse`) does not rise: where the search ends higher, the result
        is this fit with a warning. With an `objective` of your own its cost counts, penalties included, and the error
        may rise. Raises InputError for a nonlinear ARX model, which takes no start.
        """
        found: Self = handler(self).refine(self, data, **options)
        return found

    @checked
    def noise_model(self, data: IOData | None = None) -> Any:
        """The colour of the residuals as an autoregression, see `sysid.linear.noise.Noise`."""
        return handler(self).noise_model(self, data)

    @checked
    def modes(self, data: IOData | None = None) -> Any:
        """Poles with natural frequency, damping and time constant, and standard deviations (`sysid.linear.modes`)."""
        return handler(self).modes(self, data)
