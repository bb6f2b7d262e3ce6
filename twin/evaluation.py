"""One model fitted to one record, with everything that a report or a table shows of it, as finished numbers."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import sysid
from sysid.criteria import fit_percent
from sysid.data import IOData
from sysid.errors import InputError, unknown
from sysid.residuals import ResidualTests

OVERFITTED = 10.0  # points of fit between the two parts that a report speaks of
Progress = Callable[[str], None] | None


@dataclass(frozen=True)
class Setting:
    """What is fitted and how: a structure with its orders and maps, a search, starts and seed.

    A map of None is the structure's own default. Raises InputError for names that do not exist, before any work.
    """

    structure: str = "hammerstein_wiener"
    nb: int = 2
    nf: int = 3
    nk: int = 1
    input_map: str | None = None
    output_map: str | None = None
    search: str = "auto"
    starts: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        if self.search not in sysid.searches.TABLE:
            raise unknown("search", self.search, sysid.searches.TABLE)
        self.model()

    def model(self) -> Any:
        """The chain before it is fitted."""
        return sysid.structures.build(self.structure, self.nb, self.nf, self.nk, self.input_map, self.output_map)

    def as_dict(self) -> dict[str, Any]:
        """The setting by option name."""
        values = asdict(self)
        return {"orders": {k: values.pop(k) for k in ("nb", "nf", "nk")}, **values}


@dataclass(frozen=True)
class Curve:
    """A line to draw: x (n,) and y (n,)."""

    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class Evaluation:
    """A fit with its free runs over both parts of the record and the tests of its validation residuals.

    `estimation_output` and `validation_output` (N,) are on the scale of their data; `step` is the step response of the
    tangent linear model (None where there is no such model); `maps` holds the static curves that the structure has,
    in the order of the signal; `tests` is None, with the reason in `notes`, where the validation part is too short.
    """

    setting: Setting
    fit: sysid.Fit
    estimation: IOData
    validation: IOData
    estimation_output: np.ndarray
    validation_output: np.ndarray
    estimation_fit: float
    validation_fit: float
    tests: ResidualTests | None
    step: Curve | None
    maps: dict[str, Curve]
    notes: tuple[str, ...] = ()

    @property
    def stable(self) -> bool:
        """Whether every pole of the linear block lies inside the unit circle."""
        return bool(np.all(np.abs(self.fit.poles) < 1.0))

    def as_dict(self) -> dict[str, Any]:
        """The summary, ready for JSON."""
        return {
            "fit_percent": {"estimation": self.estimation_fit, "validation": self.validation_fit},
            **self.fit.summary(),
            "stable": self.stable,
            "residuals": self.tests.as_dict() if self.tests else None,
            "setting": self.setting.as_dict(),
            "notes": list(self.notes),
        }


def evaluate(setting: Setting, estimation: IOData, validation: IOData, progress: Progress = None) -> Evaluation:
    """Fits `setting` to `estimation` and runs it free over both parts; only `estimation` is ever fitted to."""
    _check_can_be_scored(estimation, "estimation")
    _check_can_be_scored(validation, "validation")
    fit = sysid.fit(
        setting.model(),
        estimation,
        search=setting.search,
        starts=setting.starts,
        seed=setting.seed,
        progress=progress,
    )
    notes = list(fit.warnings)
    tests = None
    try:
        tests = fit.residual_tests(validation)
    except InputError as error:
        notes.append(f"no residual tests: {error}")
    step = _step_response(fit, float(np.mean(estimation.u)))
    if step is None:
        notes.append("no step response: the tangent model has no finite one")
    # Where it was fitted, a model's initial state is part of the fit; where it was not, the first samples must do.
    fitted = np.ravel(fit.simulate(estimation, estimation.N))
    fits = fit_percent(estimation.y[:, 0], fitted), fit.fit_percent(validation)
    if fits[0] - fits[1] > OVERFITTED:
        notes.append(
            f"the fit is {fits[0]:.0f} % where it was fitted and {fits[1]:.0f} % where it was not: the model is too "
            "large for this record, or its parts differ; lower the orders, choose smaller maps or look at the data"
        )
    return Evaluation(
        setting=setting,
        fit=fit,
        estimation=estimation,
        validation=validation,
        estimation_output=fitted,
        validation_output=np.ravel(fit.simulate(validation)),
        estimation_fit=fits[0],
        validation_fit=fits[1],
        tests=tests,
        step=step,
        maps=_maps(fit, estimation),
        notes=tuple(notes),
    )


def _check_can_be_scored(data: IOData, part: str) -> None:
    for role, values in (("input", data.u), ("output", data.y)):
        if np.ptp(values) == 0:
            raise InputError(
                f"the {role} does not move in the {part} part ({data.N} samples); choose another split or record"
            )


def _step_response(fit: sysid.Fit, u0: float) -> Curve | None:
    """Response [y per u] to a unit step of the model that is tangent at u0, until its slowest pole has settled."""
    import control

    poles = np.abs(fit.poles)
    slowest = min(float(poles.max(initial=0.0)), 0.999)
    samples = int(np.clip(np.ceil(np.log(0.01) / np.log(max(slowest, 0.1))), 20, 2000)) + 10
    with np.errstate(all="ignore"):
        response = control.step_response(sysid.linearize.tangent(fit, u0), T=np.arange(samples) * fit.Ts)
    y = np.ravel(response.outputs)
    return Curve(np.ravel(response.time), y) if np.all(np.isfinite(y)) else None


def _maps(fit: sysid.Fit, data: IOData) -> dict[str, Curve]:
    """The static maps over the range that the estimation data visited."""
    maps, x = {}, np.ascontiguousarray(data.u[:, 0])
    for block in fit.model.blocks:
        if block.role in ("input", "output"):
            grid = np.linspace(x.min(), x.max(), 201)
            y = fit.curve(block.role, grid)
            if y is not None:
                maps[block.role] = Curve(grid, y)
        x = block.propagate(fit.model.part(fit.theta, block), x, np.empty((len(x), 0)), 0)
    return maps
