"""One model fitted to one record, with all numbers that a report or a table shows."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import StaticBlock
from sysid.blocks import Channels
from sysid.data.record import IOData
from sysid.diagnosis.higher_order import HigherOrderTests, higher_order_tests
from sysid.diagnosis.residuals import ResidualTests
from sysid.estimation.result import Fit
from sysid.joint.growth import Growth, grow_joint
from sysid.joint.values import JointValue, as_read, in_unit, joint_values
from sysid.joint.verdict import Verdict, verdict
from sysid.linear import linearize
from sysid.nlarx.dispatch import fit as fit_model
from sysid.nlarx.fit import ITERATIONS as NETWORK_ITERATIONS
from sysid.nlarx.model import Nlarx
from sysid.nlarx.result import NlarxFit
from sysid.solver.iterate import Options
from sysid.uncertainty import intervals
from sysid.uncertainty.information import information
from sysid.uncertainty.intervals import Root
from sysid.workflow.extrapolation import extrapolated_joint, extrapolated_signals
from sysid.workflow.gain_sign import gain_remarks
from sysid.workflow.outputs import OneOutput, is_several, residuals_and_inputs, tests_of, worst
from sysid.workflow.outputs import fits as fits_of
from sysid.workflow.setting import Setting

RUNAWAY = 3.0  # widths of the output's range from its middle, beyond which a free run has left the data
OVERFITTED = 10.0  # points of fit between the two parts that a report speaks of
APART = 3.0  # the same of a joint, whose two parts are the same physics
AMPLE = 100  # samples for each parameter
Progress = Callable[[str], None] | None


@dataclass(frozen=True)
class Curve:
    """A line to draw: x (n,) and y (n,)."""

    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class OneStep:
    """One-step-ahead prediction of a nonlinear ARX model from the measured outputs.

    Outputs (N,) on the scale of their data, fits in %. The fit is near 100 % for any smooth, finely sampled signal: do
    not compare it with the fit of a free run.
    """

    estimation_output: np.ndarray
    validation_output: np.ndarray
    estimation_fit: float
    validation_fit: float

    def as_dict(self) -> dict[str, float]:
        """The two fits [%]."""
        return {"estimation": self.estimation_fit, "validation": self.validation_fit}


@dataclass(frozen=True)
class Evaluation:
    """A fit with its free-run simulations of both parts of the record and the tests of its validation residuals.

    `estimation_output` and `validation_output` (N,) are on the scale of their data; `step` is the step response of the
    tangent linear model (None if there is no such model). `maps` holds the static curves in the order of the signal.
    `tests` and `higher` are None if the validation part is too short; `notes` gives the reason. `roots` are the poles
    with their intervals, None if the record gives none. A nonlinear ARX model has `one_step` and neither poles nor
    maps. An actuated joint has `values`, `growth` and `joint`, and no poles; where `joint` says that the record is not
    that of a joint, there are no values. Of several inputs or outputs the runs are (N, ny), the fits means over the
    outputs, `outputs` has those of each, `inputs` names and units; `tests` are the worst.
    """

    setting: Setting
    fit: Fit | NlarxFit
    estimation: IOData
    validation: IOData
    estimation_output: np.ndarray
    validation_output: np.ndarray
    estimation_fit: float
    validation_fit: float
    tests: ResidualTests | None
    higher: HigherOrderTests | None
    step: Curve | None
    maps: dict[str, Curve]
    roots: tuple[Root, ...] | None = None
    one_step: OneStep | None = None
    values: tuple[JointValue, ...] = ()
    growth: Growth | None = None
    joint: Verdict | None = None
    notes: tuple[str, ...] = ()
    inputs: tuple[tuple[str, str], ...] = ()
    outputs: tuple[OneOutput, ...] = ()

    @property
    def linear(self) -> bool:
        """Whether the model has a linear block, and therefore poles."""
        return isinstance(self.fit, Fit) and bool(self.fit.model.dynamics)

    @property
    def poles(self) -> np.ndarray:
        """Poles in z of the linear block; empty if there is no such block."""
        return self.fit.poles if isinstance(self.fit, Fit) else np.empty(0, dtype=complex)

    @property
    def zeros(self) -> np.ndarray:
        """Zeros in z of the linear block; empty if there is no such block."""
        return self.fit.zeros if isinstance(self.fit, Fit) else np.empty(0, dtype=complex)

    @property
    def stable(self) -> bool:
        """Whether all poles of the linear block are inside the unit circle.

        Without such a block: whether both free runs stay within RUNAWAY widths of the range of the output.
        """
        if self.linear:
            return bool(np.all(np.abs(self.poles) < 1.0))
        y = np.concatenate([self.estimation.y, self.validation.y])
        run = np.concatenate([self.estimation_output, self.validation_output]).reshape(y.shape)
        away = np.abs(run - 0.5 * (y.max(axis=0) + y.min(axis=0)))
        return bool(np.all(away.max(axis=0) <= RUNAWAY * np.ptp(y, axis=0)))

    def as_dict(self) -> dict[str, Any]:
        """The summary, ready for JSON."""
        summary = {
            **({"verdict": self.joint.sentence()} if self.joint is not None and not self.joint.joint else {}),
            "fit_percent": {"estimation": self.estimation_fit, "validation": self.validation_fit},
            **self.fit.summary(),
            "stable": self.stable,
            "residuals": self.tests.as_dict() if self.tests else None,
            "higher_order": self.higher.as_dict() if self.higher else None,
            "setting": self.setting.as_dict(),
            "notes": list(self.notes),
        }
        if self.outputs:
            summary["outputs"] = [output.as_dict() for output in self.outputs]
            summary["fit_percent"]["outputs"] = {
                output.name: {"estimation": output.estimation_fit, "validation": output.validation_fit}
                for output in self.outputs
            }
        if self.roots is not None:
            for row, root in zip(summary["poles"], self.roots, strict=True):
                row["intervals"] = {
                    name: [getattr(root, name).lower, getattr(root, name).upper]
                    for name in ("real", "imag", "modulus", "time_constant")
                }
                row["note"] = root.note
        if self.one_step is not None:
            summary["one_step_fit_percent"] = self.one_step.as_dict()
        if self.values:
            summary["values"] = [vars(as_read(value)) for value in self.values]
        if self.growth is not None:
            summary["growth"] = self.growth.as_dict()
        if self.joint is not None:
            summary["joint"] = self.joint.as_dict()
        return summary


def evaluate(setting: Setting, estimation: IOData, validation: IOData, progress: Progress = None) -> Evaluation:
    """Fits `setting` to `estimation` and simulates both parts in free run; `validation` is never used in the fit."""
    check_parts(estimation, validation)
    options: dict[str, Any] = {"starts": setting.starts, "seed": setting.seed, "progress": progress}
    recipe = setting.recipe
    setting = replace(setting, search=recipe.auto if setting.search == "auto" else setting.search)
    model, start = setting.held.apply(recipe.model_of(estimation), estimation, recipe.grown)
    if recipe.grown and start is None:
        growth = grow_joint(estimation, model, search=setting.search, seconds=setting.seconds, **options)
        gone = setting.held.missing_in(growth.fit.model)
        said = verdict(growth, estimation)
        found = evaluate_fit(setting, growth.fit, estimation, validation, physical=said.joint)
        return replace(found, growth=growth, joint=said, notes=(*found.notes, *growth.warnings, *gone))
    if start is not None:
        options["start"] = start
    if setting.seconds < np.inf:
        usual = NETWORK_ITERATIONS if isinstance(model, Nlarx) else Options.max_iterations
        options["options"] = Options(max_iterations=usual, max_seconds=setting.seconds)
    try:
        fit = fit_model(model, estimation, search=setting.search, **options)
    except InputError as error:
        if not setting.held or "not a valid model" not in str(error):
            raise
        raise InputError(
            "with what --fix and --bound hold, no start is a valid model, for example because its poles would be "
            "outside the unit circle; hold other values, hold all coefficients of a filter, or start with --from"
        ) from None
    found = evaluate_fit(setting, fit, estimation, validation)
    if fit.seconds < setting.seconds:
        return found
    early = (
        f"the fit was stopped after {setting.seconds:g} s with the best so far; for all of the search run it again "
        f"with --seconds {2.0 * setting.seconds:g}, or without --seconds"
    )
    return replace(found, notes=(early, *found.notes))


def evaluate_fit(
    setting: Setting, fit: Fit | NlarxFit, estimation: IOData, validation: IOData, physical: bool = True
) -> Evaluation:
    """Simulates a model fitted to `estimation` by `setting` in free run, and tests its residuals on `validation`.

    Without `physical` the physical values of a structure that has them are left out.
    """
    chain = fit if isinstance(fit, Fit) else None
    network = fit if isinstance(fit, NlarxFit) else None
    notes = list(fit.warnings)
    tests = higher = None
    each: tuple[ResidualTests, ...] = ()
    several = is_several(estimation)
    try:
        if chain is not None and several:
            each = tests_of(chain, validation)
            tests = worst(each)
        else:
            tests = fit.residual_tests(validation)
            higher = _higher_order(fit, validation)
    except InputError as error:
        notes.append(f"no residual tests: {error}")
    step, physics = None, setting.recipe.physics() if physical else None
    if chain is not None and chain.model.dynamics and not several:
        step = _step_response(chain, float(np.mean(estimation.u)))
        if step is None:
            notes.append("no step response: the tangent model has no finite step response")
    # Where it was fitted, a chain's initial state is part of the fit; where it was not, the first samples must do.
    fitted = fit.simulate(estimation, estimation.N if chain else None)
    run = fit.simulate(validation)
    seen = fits_of(estimation, fitted, 0 if chain else fit.n_init)
    fits = float(np.mean(seen)), fit.fit_percent(validation)
    if not np.isfinite(fits[1]):
        notes.append(f"in the validation data {fit.divergence(validation)}")
    elif network and (left := network.excursion(validation)):
        notes.append(f"in the validation data {left}")
    if np.isfinite(fits).all() and fits[0] - fits[1] > (OVERFITTED if physics is None else APART):
        known, unseen = (f"{f:.0f} %" if f > -1000 else "below -1000 %" for f in fits)
        if physics is not None:
            cause = (
                "the joint meets something there that the estimation data do not show, for example a moment at a stop; "
                "qpal design FILE proposes a record of which each half shows all"
            )
        else:
            size = "" if ample(fit) else "the model is too large for this record, or "
            cause = f"{size}the two parts differ; lower the orders, choose smaller maps or inspect the data"
        notes.append(f"the fit is {known} on the estimation data and {unseen} on the validation data: {cause}")
    notes += gain_remarks(estimation, validation, run, None if step is None else step.y)
    if chain is not None:
        notes += [f"in the validation data {text}" for text in chain.model.remarks(chain.theta, validation.u)]
    physical = chain is not None and physics is not None
    if chain and physical:
        notes += extrapolated_joint(chain, estimation, validation)
    else:
        notes += extrapolated_signals(estimation, validation)
    return Evaluation(
        setting=setting,
        fit=fit,
        estimation=estimation,
        validation=validation,
        estimation_output=fitted,
        validation_output=run,
        estimation_fit=fits[0],
        validation_fit=fits[1],
        tests=tests,
        higher=higher,
        step=step,
        maps=_maps(chain, estimation) if chain else {},
        roots=_roots(chain, estimation, coloured=tests is not None and not tests.white) if chain else None,
        one_step=_one_step(network, estimation, validation) if network else None,
        values=_values(chain, estimation, physics) if chain and physics is not None else (),
        notes=tuple(notes),
        inputs=tuple((f"u{i}", estimation.u_unit) for i in range(1, estimation.u.shape[1] + 1)) if several else (),
        outputs=_outputs(chain, estimation, validation, seen, each) if chain and several else (),
    )


def _outputs(
    fit: Fit, estimation: IOData, validation: IOData, seen: np.ndarray, tests: tuple[ResidualTests, ...]
) -> tuple[OneOutput, ...]:
    """Every output with its fits and tests; a record names them y1, y2 until its file does."""
    rows = zip(seen.tolist(), fit.fit_percents(validation).tolist(), tests or [None] * len(seen), strict=True)
    return tuple(OneOutput(f"y{j}", estimation.y_unit, *row) for j, row in enumerate(rows, 1))


def check_parts(estimation: IOData, validation: IOData) -> None:
    """Raises InputError if a signal is constant in one of the two parts, because no fit or score is possible there."""
    _check_can_be_scored(estimation, "estimation")
    _check_can_be_scored(validation, "validation")


def ample(fit: Fit | NlarxFit) -> bool:
    """Whether the record has so many samples for each parameter that their number cannot overfit it."""
    return isinstance(fit, Fit) and AMPLE * fit.criteria.d < fit.criteria.N


def _one_step(fit: NlarxFit, estimation: IOData, validation: IOData) -> OneStep:
    return OneStep(
        fit.predict(estimation),
        fit.predict(validation),
        fit.prediction_percent(estimation),
        fit.prediction_percent(validation),
    )


def _higher_order(fit: Fit | NlarxFit, data: IOData) -> HigherOrderTests:
    e, u = residuals_and_inputs(fit, data)
    return higher_order_tests(e[:, 0], u[:, 0])


def _roots(fit: Fit, data: IOData, coloured: bool) -> tuple[Root, ...] | None:
    """Poles with intervals that allow for coloured residuals; None if they cannot be computed."""
    if not fit.model.dynamics:
        return None
    try:
        return intervals.poles(information(fit, data, lags="auto" if coloured else None))
    except InputError:
        return None


def _check_can_be_scored(data: IOData, part: str) -> None:
    signals = [*(("input", x) for x in data.u.T), *(("output", x) for x in data.y.T)]
    for role, values in signals:
        if np.ptp(values) == 0:
            raise InputError(
                f"the {role} does not move in the {part} part ({data.N} samples); choose another split or record"
            )


def _values(fit: Fit, data: IOData, options: dict[str, Any]) -> tuple[JointValue, ...]:
    """Physical values with the output's unit in place of y."""
    return in_unit(joint_values(fit, data=data, **options), data.y_unit)


def _step_response(fit: Fit, u0: float) -> Curve | None:
    """Unit step response [y per u] of the model tangent at u0, until its slowest pole has settled."""
    from sysid.base.looks import load

    load()  # matplotlib, which control imports, whatever its settings are
    import control

    poles = np.abs(fit.poles)
    slowest = min(float(poles.max(initial=0.0)), 0.999)
    samples = int(np.clip(np.ceil(np.log(0.01) / np.log(max(slowest, 0.1))), 20, 2000)) + 10
    try:
        tangent = linearize.tangent(fit, u0)
    except InputError:  # a model that integrates has no operating point under a constant input
        return None
    numerator = np.abs(np.ravel(getattr(tangent, "num_array", [[1.0]])[0][0])).max()
    unit = 2.0 ** np.floor(np.log2(numerator)) if 0.0 < numerator < np.inf else 1.0  # scipy drops terms below 1e-14
    with np.errstate(all="ignore"):
        response = control.step_response(tangent / unit, T=np.arange(samples) * fit.Ts)
        y = unit * np.ravel(response.outputs)
    return Curve(np.ravel(response.time), y) if np.all(np.isfinite(y)) else None


def _maps(fit: Fit, data: IOData) -> dict[str, Curve]:
    """The static maps over the range of the estimation data, by role."""
    maps = {}
    for block, x in zip(fit.model.blocks, fit.model.signals(fit.theta, data.u), strict=False):
        if isinstance(block, StaticBlock):
            grid = np.linspace(x.min(), x.max(), 201)
            y = fit.curve(block.role, grid)
            if y is not None:
                maps[block.role] = Curve(grid, y)
        elif isinstance(block, Channels):
            theta = fit.model.part(fit.theta, block)
            for k, ((part, each), column) in enumerate(zip(block.parts(), x.T, strict=True), 1):
                grid = np.linspace(column.min(), column.max(), 201)
                if isinstance(each, StaticBlock) and each.n_parameters:
                    maps[f"{block.role} {k}"] = Curve(grid, each.output(theta[part], grid))
    return maps
