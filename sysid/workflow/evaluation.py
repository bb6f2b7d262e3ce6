"""One model fitted to one record, with all numbers that a report or a table shows."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from sysid.base.criteria import fit_percent
from sysid.base.errors import InputError
from sysid.base.poles import Motion, motion
from sysid.base.quantities import unit_of_channel
from sysid.block.block import StaticBlock
from sysid.blocks import Channels, Predictor
from sysid.blocks.offset import is_offset
from sysid.data.record import IOData
from sysid.diagnosis.residuals import (
    POOR,
    UNTESTED,
    HigherOrderTests,
    ResidualTests,
    higher_order_tests,
    residual_tests,
)
from sysid.estimation.objective import Objective
from sysid.estimation.result import Fit
from sysid.fitting import fit as fit_model
from sysid.joint.posterior import fit_joint
from sysid.joint.transfer import joint_band
from sysid.joint.values import JointValue, joint_values
from sysid.joint.verdict import verdict
from sysid.linear import linearize
from sysid.model.chain import Chain
from sysid.nlarx.fit import ITERATIONS as NETWORK_ITERATIONS
from sysid.nlarx.model import Nlarx
from sysid.nlarx.result import NlarxFit
from sysid.solver.iterate import Options
from sysid.structures import ActuatedJoint
from sysid.uncertainty import bands, intervals
from sysid.uncertainty.bands import OutputBand
from sysid.uncertainty.information import information
from sysid.uncertainty.intervals import Root
from sysid.workflow.named_values import named_values
from sysid.workflow.remarks import extrapolated_joint, extrapolated_signals, gain_remarks, warnings_of
from sysid.workflow.results import Curve, Evaluation, Growing, OneOutput, OneStep, fall_between
from sysid.workflow.setting import Setting

OVERFITTED = 10.0  # points of fit between the two parts that a report speaks of
APART = 3.0  # the same of a joint, whose two parts are the same physics
AMPLE = 100  # samples for each parameter
_FAR = 20  # samples over which the prediction of a model that integrates is judged
_DIVERGED = -1000.0  # [%] of fit, below which a number says no more than that the run has left the data
Progress = Callable[[str], None] | None


def evaluate(setting: Setting, estimation: IOData, validation: IOData, progress: Progress = None) -> Evaluation:
    """Fits `setting` to `estimation` and simulates both parts in free run; `validation` is never used in the fit."""
    check_parts(estimation, validation)
    options: dict[str, Any] = {"starts": setting.starts, "seed": setting.seed, "progress": progress}
    recipe = setting.recipe
    setting = replace(setting, search=recipe.auto if setting.search == "auto" else setting.search)
    model, start = setting.held.apply(recipe.model_of(estimation), estimation, recipe.with_parts)
    if recipe.with_parts and start is None:
        found = fit_joint(estimation, model, search=setting.search, seconds=setting.seconds, **options)
        joint = verdict(found, estimation)
        result = evaluate_fit(setting, found.fit, estimation, validation, physical=joint.joint)
        return replace(result, joint_fit=found, joint=joint, notes=(*result.notes, *found.warnings))
    if start is not None:
        saved = setting.held.start
        same = saved is not None and isinstance(model, Chain) and model.blocks == saved.model.blocks
        options["start"] = replace(saved, model=model, theta=start) if saved is not None and same else start
    if setting.seconds < np.inf:
        iterations = NETWORK_ITERATIONS if isinstance(model, Nlarx) else Options.max_iterations
        options["options"] = Options(max_iterations=iterations, max_seconds=setting.seconds)
    if isinstance(model, Chain):
        prior = options["start"].prior if isinstance(options.get("start"), Fit) else None
        options["objective"] = Objective(knots=setting.knots, prior=prior)
    try:
        fit = fit_model(model, estimation, search=setting.search, **options)
    except InputError as error:
        if not setting.held or "not a valid model" not in str(error):
            raise
        raise InputError(
            "with what --fix and --bound hold, no start is a valid model, for example because its poles would be "
            "outside the unit circle; hold other values, hold all coefficients of a filter, or start with --from"
        ) from None
    result = evaluate_fit(setting, fit, estimation, validation)
    if fit.seconds < setting.seconds:
        return result
    note = (
        f"the fit was stopped after {setting.seconds:g} s with the best so far; for all of the search run it again "
        f"with --seconds {2.0 * setting.seconds:g}, or without --seconds"
    )
    return replace(result, notes=(note, *result.notes))


def evaluate_fit(
    setting: Setting, fit: Fit | NlarxFit, estimation: IOData, validation: IOData, physical: bool = True
) -> Evaluation:
    """Simulates a model fitted to `estimation` by `setting` in free run, and tests its residuals on `validation`.

    Without `physical` the physical values of a structure that has them are left out.
    """
    chain = fit if isinstance(fit, Fit) else None
    network = fit if isinstance(fit, NlarxFit) else None
    several = has_several_channels(estimation)
    physics = setting.recipe.physics() if physical else None
    notes = warnings_of(fit, joint=isinstance(setting.recipe, ActuatedJoint))
    tests, higher, output_tests, remarks = _residual_tests(fit, validation, several)
    notes += remarks
    step = None
    if chain is not None and chain.model.has_poles and not several:
        step = _step_response(chain, float(np.mean(estimation.u)))
        if step is None:
            notes.append("no step response: the tangent model has no finite step response")
    # Where it was fitted, a free run's initial state is part of the fit; where it was not, the first samples must do.
    estimation_run = fit.simulate(estimation, None if fit.predicts else estimation.N)
    validation_run = fit.simulate(validation)
    output_fits = fits_of_outputs(estimation, estimation_run, fit.n_init if fit.predicts else 0)
    fits = float(np.mean(output_fits)), fit.fit_percent(validation)
    one_step = _one_step(fit, estimation, validation) if fit.predicts else None
    if one_step is not None and one_step.growth is not None:
        fits_compared = one_step.estimation_fit, one_step.validation_fit
    else:
        fits_compared = fits
    if not np.isfinite(fits_compared[1]):
        notes.append(f"in the validation data {fit.divergence(validation)}")
    elif network and (excursion := network.excursion(validation)):
        notes.append(f"in the validation data {excursion}")
    allowed = OVERFITTED if physics is None else APART
    if validation is not estimation and fall_between(fits_compared, estimation, validation) > allowed:
        notes += _difference_of_parts(fit, fits_compared, joint=physics is not None)
    notes += gain_remarks(estimation, validation, validation_run, None if step is None else step.y)
    if chain is not None:
        notes += [f"in the validation data {text}" for text in chain.model.remarks(chain.theta, validation.u)]
    if chain and physics is not None:
        notes += extrapolated_joint(chain, estimation, validation)
    else:
        notes += extrapolated_signals(estimation, validation)
    coloured = tests is not None and not tests.white
    roots, band = _uncertainty(chain, estimation, validation, coloured) if chain else (None, None)
    return Evaluation(
        setting=setting,
        fit=fit,
        estimation=estimation,
        validation=validation,
        estimation_output=estimation_run,
        validation_output=validation_run,
        estimation_fit=fits[0],
        validation_fit=fits[1],
        tests=tests,
        higher=higher,
        step=step,
        maps=_maps(chain, estimation) if chain else {},
        roots=roots,
        one_step=one_step,
        values=_values(chain, estimation, physics) if chain else (),
        notes=tuple(notes),
        inputs=tuple((f"u{i}", unit_of_channel(estimation.u_unit, i - 1)) for i in range(1, estimation.u.shape[1] + 1))
        if several
        else (),
        outputs=_outputs(chain, estimation, validation, output_fits, output_tests) if chain and several else (),
        band=band,
    )


def _values(fit: Fit, data: IOData, physics: dict[str, Any] | None) -> tuple[JointValue, ...]:
    """Physical values: of a joint, with its options `physics`, else of a model whose parameters have names."""
    return named_values(fit, data) if physics is None else joint_values(fit, data=data, **physics)


def _residual_tests(
    fit: Fit | NlarxFit, validation: IOData, several: bool
) -> tuple[ResidualTests | None, HigherOrderTests | None, tuple[ResidualTests, ...], list[str]]:
    """Tests of the residuals, higher-order tests, the tests of each of `several` outputs, and why there are none."""
    tests = None
    try:
        if isinstance(fit, Fit) and several:
            output_tests = tests_of_outputs(fit, validation)
            return worst_tests(output_tests), None, output_tests, []
        tests = fit.residual_tests(validation)
        e, u = residuals_and_inputs(fit, validation)
        later = isinstance(fit, Fit) and fit.predicts  # an input at the same time may come from the error by feedback
        return tests, higher_order_tests(e[later:, 0], u[: len(u) - later, 0]), (), []
    except InputError as error:
        return tests, None, (), [f"{UNTESTED}{error}"]


def _difference_of_parts(fit: Fit | NlarxFit, fits: tuple[float, float], joint: bool) -> list[str]:
    """A sentence where the fit [%] of the validation data is far below that of the estimation data, and why."""
    if not np.isfinite(fits).all():
        return []
    words = [f"{percent:.0f} %" if percent > _DIVERGED else f"below {_DIVERGED:.0f} %" for percent in fits]
    if joint:
        cause = (
            "the joint meets something there that the estimation data do not show, for example a moment at an end "
            "stop; qpal design FILE proposes a record of which each half shows all"
        )
    else:
        size = "" if has_ample_samples(fit) else "the model is too large for this record, or "
        blocks = fit.model.blocks if isinstance(fit, Fit) else ()
        has_map = any(isinstance(b, StaticBlock | Channels) and not is_offset(b) for b in blocks)
        smaller = ", choose smaller maps" if has_map else ""
        cause = f"{size}the two parts differ; lower the orders{smaller} or inspect the data"
    return [f"the fit is {words[0]} on the estimation data and {words[1]} on the validation data: {cause}"]


def _outputs(
    fit: Fit, estimation: IOData, validation: IOData, fits: np.ndarray, tests: tuple[ResidualTests, ...]
) -> tuple[OneOutput, ...]:
    """Every output with its fits and tests; a record names them y1, y2 until its file does."""
    rows = zip(fits.tolist(), fit.fit_percents(validation).tolist(), tests or [None] * len(fits), strict=True)
    return tuple(OneOutput(f"y{j}", unit_of_channel(estimation.y_unit, j - 1), *row) for j, row in enumerate(rows, 1))


def check_parts(estimation: IOData, validation: IOData) -> None:
    """Raises InputError if a signal is constant in one of the two parts, because no fit or score is possible there."""
    for part, data in (("estimation", estimation), ("validation", validation)):
        for role, values in (*(("input", x) for x in data.u.T), *(("output", x) for x in data.y.T)):
            if np.ptp(values) == 0:
                raise InputError(
                    f"the {role} does not move in the {part} part ({data.N} samples); choose another split or record"
                )


def moves_in_one_part(estimation: IOData, validation: IOData) -> bool:
    """Whether the input moves, but not in both parts, as in a step test: then neither part is one to validate on."""
    parts = [bool(np.any(np.ptp(data.u, axis=0) == 0)) for data in (estimation, validation)]
    both = np.concatenate([estimation.u + estimation.u_offset, validation.u + validation.u_offset])
    return any(parts) and not np.any(np.ptp(both, axis=0) == 0)


def has_ample_samples(fit: Fit | NlarxFit) -> bool:
    """Whether the record has so many samples for each parameter that their number cannot overfit it; the inputs before
    the record, which a delay lets through, are the record's.
    """
    if not isinstance(fit, Fit):
        return False
    past = sum(getattr(block, "history", 0) for block in fit.model.blocks)
    return AMPLE * min(fit.criteria.d, int(fit.model.free.sum()) - past) < fit.criteria.N


def _one_step(fit: Fit | NlarxFit, estimation: IOData, validation: IOData) -> OneStep:
    return OneStep(
        fit.predict(estimation),
        fit.predict(validation),
        fit.prediction_percent(estimation),
        fit.prediction_percent(validation),
        growth(fit, validation) if isinstance(fit, Fit) else None,
    )


def growth(fit: Fit, validation: IOData) -> Growing | None:
    """The prediction that tells a right model that does not settle from a wrong one.

    As far ahead as the model's own noise leaves a fit that is not poor, at most to where errors have grown e times, or
    `_FAR` samples: further ahead the best of models is bad.
    """
    if fit.settles:
        return None
    rate = float(np.log(np.abs(fit.poles).max()))
    far = int(np.clip(round(1.0 / rate) if rate > 1.0 / _FAR else _FAR, 2, _FAR))
    (part, block), *_ = fit.model.dynamics
    assert isinstance(block, Predictor)
    spread = np.sqrt(fit.criteria.mse) * block.error_spread(fit.theta[part], far)
    horizon = max(1, int(np.sum(100.0 * (1.0 - spread / max(float(validation.y.std()), 1e-300)) >= POOR)))
    return Growing(horizon, fit.prediction_percent(validation, horizon=horizon))


def _uncertainty(
    fit: Fit, estimation: IOData, validation: IOData, coloured: bool
) -> tuple[tuple[Root, ...] | None, OutputBand | None]:
    """Poles with intervals that allow for coloured residuals, and the band of the validation run; None without one."""
    try:
        if not fit.model.has_poles:
            is_banded = fit.prior is not None and len(validation.experiments) == 1
            return None, joint_band(fit, estimation, validation) if is_banded else None
        info = information(fit, estimation, lags="auto" if coloured else None)
        roots = intervals.poles(info)
        free_run = not fit.predicts and motion(fit.poles) != Motion.UNSTABLE and len(validation.experiments) == 1
        return roots, bands.linear(info, validation, noise=True) if free_run else None
    except InputError:
        return None, None


def _step_response(fit: Fit, u0: float) -> Curve | None:
    """Unit step response [y per u] of the model tangent, until its slowest pole settled to 1 % or grew 100 times."""
    poles = np.abs(fit.poles)
    largest = float(poles.max(initial=0.0))
    slowest = min(largest, 1.0 / max(largest, 1.0), 0.999)
    samples = int(np.clip(np.ceil(np.log(0.01) / np.log(max(slowest, 0.1))), 20, 2000)) + 10
    try:
        B, F = linearize.fraction(fit, u0)
    except InputError:  # a model that integrates has no operating point under a constant input
        return None
    with np.errstate(all="ignore"):
        y = lfilter(B, F, np.ones(samples))
    return Curve(np.arange(samples) * fit.Ts, y) if np.all(np.isfinite(y)) else None


def _maps(fit: Fit, data: IOData) -> dict[str, Curve]:
    """The static maps over the range of the estimation data, by role; the last one with the offset behind it."""
    maps = {}
    signals = fit.model.signals(fit.theta, data.u)
    for k, (block, x) in enumerate(zip(fit.model.blocks, signals, strict=False)):
        if is_offset(block):
            continue
        if isinstance(block, StaticBlock):
            grid = np.linspace(x.min(), x.max(), 201)
            y = fit.curve(block.role, grid)
            if y is not None:
                last = all(map(is_offset, fit.model.blocks[k + 1 :]))
                maps[block.role] = Curve(grid, fit.model.through(fit.theta, y, k + 1) if last else y)
        elif isinstance(block, Channels):
            theta = fit.model.part(fit.theta, block)
            for channel, ((slots, part_block), column) in enumerate(zip(block.parts(), x.T, strict=True), 1):
                grid = np.linspace(column.min(), column.max(), 201)
                if isinstance(part_block, StaticBlock) and part_block.n_parameters:
                    maps[f"{block.role} {channel}"] = Curve(grid, part_block.output(theta[slots], grid))
    return maps


def has_several_channels(data: IOData) -> bool:
    """Whether a record has more than one input or output."""
    return data.u.shape[1] > 1 or data.y.shape[1] > 1


def fits_of_outputs(data: IOData, run: np.ndarray, first: int = 0) -> np.ndarray:
    """Fit [%] of each output (ny,) of a run (N,) or (N, ny) over its measured samples from `first` on."""
    scored = data.observed & (np.arange(data.N) >= first)[:, None]
    runs, numbers = run.reshape(data.N, -1), data.experiment_numbers
    return np.array([fit_percent(y[k], x[k], numbers[k]) for y, x, k in zip(data.y.T, runs.T, scored.T, strict=True)])


def residuals_and_inputs(fit: Fit | NlarxFit, data: IOData) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (M, ny) and inputs (M, nu) of all experiments, without their first samples."""
    residuals = [np.reshape(e, (len(e), -1)) for e in (fit.residuals(part) for part in data.experiments)]
    inputs = [part.u[part.N - len(e) :] for part, e in zip(data.experiments, residuals, strict=True)]
    return np.concatenate(residuals), np.concatenate(inputs)


def tests_of_outputs(fit: Fit, data: IOData) -> tuple[ResidualTests, ...]:
    """The tests of each output's residuals, with the input of which they are least independent."""
    e, u = residuals_and_inputs(fit, data)
    if not np.all(np.isfinite(e)):
        raise InputError(f"no residuals to test: {fit.divergence(data)}")
    return tuple(worst_tests([residual_tests(residuals, x) for x in u.T]) for residuals in e.T)


def worst_tests(tests: Sequence[ResidualTests]) -> ResidualTests:
    """The whiteness test that is farthest outside its bound, beside the test that speaks most against independence."""
    whiteness = max(tests, key=lambda t: float(np.max(np.abs(t.autocorrelation[1:])) / t.whiteness_bound))
    independence = min(tests, key=lambda t: t.independence_p)
    names = ("lags", "autocorrelation", "whiteness_bound")
    return replace(independence, **{name: getattr(whiteness, name) for name in names})
