"""What identifying a file gives: the evaluated model, the record behind it, and the next step."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.base.files import versions
from sysid.base.poles import Motion, motion
from sysid.channels.signals import Signals
from sysid.data.record import IOData
from sysid.diagnosis.advice import Advice
from sysid.diagnosis.residuals import HigherOrderTests, ResidualTests
from sysid.estimation.result import Fit
from sysid.joint.posterior import JointFit
from sysid.joint.values import JointValue, displayed_value
from sysid.joint.verdict import Verdict
from sysid.nlarx.result import NlarxFit
from sysid.selection.table import Selection
from sysid.uncertainty.bands import OutputBand
from sysid.uncertainty.intervals import Root
from sysid.workflow.plan import Plan
from sysid.workflow.record import Record
from sysid.workflow.setting import Setting
from sysid.workflow.steps import NextStep

RUNAWAY = 3.0  # widths of the output's range from its middle, beyond which a free run has left the data


@dataclass(frozen=True)
class Curve:
    """A line to draw: x (n,) and y (n,)."""

    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class Growing:
    """Prediction of the validation data `horizon` samples ahead, which the noise leaves possible: its fit [%]."""

    horizon: int
    fit: float

    @property
    def ahead(self) -> str:
        """How far ahead, in words."""
        return "one step ahead" if self.horizon == 1 else f"{self.horizon} steps ahead"

    @property
    def misses(self) -> bool:
        """Whether the prediction misses its data: noise adds up in it, but more than half of it is the model's."""
        return not self.fit >= 50.0


@dataclass(frozen=True)
class OneStep:
    """One-step-ahead prediction of an ARX, ARMAX or nonlinear ARX model from the measured outputs.

    `growth` is that of a model that does not settle. Outputs (N,) on the scale of their data, fits in %. The one-step
    fit is near 100 % for any smooth, finely sampled signal: do not compare it with the fit of a free run.
    """

    estimation_output: np.ndarray
    validation_output: np.ndarray
    estimation_fit: float
    validation_fit: float
    growth: Growing | None = None

    def as_dict(self) -> dict[str, Any]:
        """The fits [%]."""
        fits = {"estimation": self.estimation_fit, "validation": self.validation_fit}
        return {**fits, **({"ahead": vars(self.growth)} if self.growth is not None else {})}


@dataclass(frozen=True)
class OneOutput:
    """One of several outputs: its free-run fits [%] of both parts, and the tests of its residuals with all inputs.

    Of the tests with the inputs, `tests` has that which speaks most against independence.
    """

    name: str
    unit: str
    estimation_fit: float
    validation_fit: float
    tests: ResidualTests | None

    def as_dict(self) -> dict[str, Any]:
        """The numbers, ready for JSON."""
        found: dict[str, Any] = {"name": self.name, "unit": self.unit}
        found["fit_percent"] = {"estimation": self.estimation_fit, "validation": self.validation_fit}
        return {**found, "residuals": self.tests.as_dict() if self.tests else None}


def fall_between(fits: tuple[float, float], estimation: IOData, validation: IOData) -> float:
    """Points from the first fit [%] to the second, both for the larger of the two outputs: where the output is smaller,
    as at the end of a chirp, the same errors are a lower fit, and nothing has become worse.
    """
    sizes = [float(np.mean(np.nanstd(np.where(d.observed, d.y, np.nan), axis=0))) for d in (estimation, validation)]
    left = [(100.0 - fit) * size / max(sizes) for fit, size in zip(fits, sizes, strict=True)]
    return left[1] - left[0]


@dataclass(frozen=True)
class Evaluation:
    """A fit with its free-run simulations of both parts of the record and the tests of its validation residuals.

    `estimation_output` and `validation_output` (N,) are on the scale of their data; `step` is the step response of the
    tangent linear model (None if there is no such model). `maps` holds the static curves in the order of the signal.
    `tests` and `higher` are None if the validation part is too short; `notes` gives the reason. `roots` are the poles
    with their intervals, None if the record gives none. A nonlinear ARX model has `one_step` and neither poles nor
    maps, an ARMAX model has all. An actuated joint has `values`, `joint_fit` and `joint`, and no poles;
    where `joint` says that the record is not that of a joint, there are no values. Of several inputs or outputs the
    runs are (N, ny), the fits means over the outputs, `outputs` has those of each, `inputs` names and units; `tests`
    are the worst. `band` is that of the validation run, from the noise and from what the estimation data leave open of
    the model; None where they give none, and of a model that predicts. Without `unseen` data the validation data are
    the estimation data again, and `validation_fit` is nan.
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
    joint_fit: JointFit | None = None
    joint: Verdict | None = None
    notes: tuple[str, ...] = ()
    inputs: tuple[tuple[str, str], ...] = ()
    outputs: tuple[OneOutput, ...] = ()
    band: OutputBand | None = None
    unseen: bool = True

    @property
    def held(self) -> float:
        """The share of the measured validation samples that `band` holds, without those that give its initial state."""
        assert self.band is not None
        y, scored = self.validation.y[:, 0], self.validation.observed[:, 0].copy()
        scored[: self.fit.n_init] = False
        inside = (self.band.lower <= y) & (y <= self.band.upper)
        return float(np.mean(inside[scored])) if scored.any() else np.nan

    @property
    def physical(self) -> bool:
        """Whether its values are those of a joint."""
        return self.setting.recipe.physics() is not None

    @property
    def linear(self) -> bool:
        """Whether the model has a linear block, and therefore poles."""
        return isinstance(self.fit, Fit) and self.fit.model.has_poles

    @property
    def poles(self) -> np.ndarray:
        """Poles in z of the linear block; empty if there is no such block."""
        return self.fit.poles if isinstance(self.fit, Fit) else np.empty(0, dtype=complex)

    @property
    def zeros(self) -> np.ndarray:
        """Zeros in z of the linear block; empty if there is no such block."""
        return self.fit.zeros if isinstance(self.fit, Fit) else np.empty(0, dtype=complex)

    @property
    def judged_fit(self) -> float:
        """The validation fit [%] that a judgement takes: of the free run, or of a prediction where that run adds up all
        errors, because the model does not settle.
        """
        seen = self.validation_fit if self.unseen else self.estimation_fit
        return seen if self.growing is None else self.growing.fit

    @property
    def fall(self) -> float:
        """Points of fit by which the validation errors exceed those of the estimation data; see `fall_between`."""
        return fall_between((self.estimation_fit, self.validation_fit), self.estimation, self.validation)

    @property
    def part(self) -> str:
        """The data that the model is judged by, in words."""
        return "validation data" if self.unseen else "record that was fitted"

    @property
    def judged(self) -> str:
        """What `judged_fit` is the fit of, in words."""
        return "free run" if self.growing is None else f"prediction {self.growing.ahead}"

    @property
    def growing(self) -> Growing | None:
        """The prediction that counts of a model that does not settle; None of other models."""
        return None if self.one_step is None else self.one_step.growth

    @property
    def motion(self) -> Motion:
        """What the poles of the linear block make of a motion."""
        return motion(self.poles)

    @property
    def stable(self) -> bool:
        """Whether all poles of the linear block are inside the unit circle.

        Without such a block: whether both free runs stay within RUNAWAY widths of the range of the output.
        """
        if self.linear:
            return self.motion == Motion.STABLE
        y = np.concatenate([self.estimation.y, self.validation.y])
        run = np.concatenate([self.estimation_output, self.validation_output]).reshape(y.shape)
        distance = np.abs(run - 0.5 * (y.max(axis=0) + y.min(axis=0)))
        return bool(np.all(distance.max(axis=0) <= RUNAWAY * np.ptp(y, axis=0)))

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
        if self.band is not None:
            summary["band"] = {"level": self.band.level, "held": self.held}
        if self.one_step is not None:
            summary["one_step_fit_percent"] = self.one_step.as_dict()
        if self.values:
            summary["values"] = [vars(displayed_value(value)) for value in self.values]
        if self.joint_fit is not None:
            summary["joint_fit"] = self.joint_fit.as_dict()
        if self.joint is not None:
            summary["joint"] = self.joint.as_dict()
        return summary


def without_validation(e: Evaluation) -> Evaluation:
    """The evaluation of a model whose record was all used for the fit: no number of unseen data, and a note says so."""
    note = (
        "the input moves in one half of the record alone, as in a step test: all of it was used for the fit, so no "
        "fit to unseen data is known; record again and give that file with --validation to have one"
    )
    notes = [each.replace("validation data", "record").replace("estimation data", "record") for each in e.notes]
    one_step = None if e.one_step is None else replace(e.one_step, validation_fit=np.nan)
    outputs = tuple(replace(output, validation_fit=np.nan) for output in e.outputs)
    return replace(
        e, validation_fit=np.nan, outputs=outputs, one_step=one_step, band=None, notes=(note, *notes), unseen=False
    )


@dataclass(frozen=True)
class Identification:
    """The record with its diagnosis, the plan by which it was prepared and split, and the model with its tests.

    `selection` is the structure search that gave the model, None if the structure was given. `asked` is the setting
    before the record added to it. `next` is the next step, None if the fit is good; `also` another one.
    """

    record: Record
    plan: Plan
    evaluation: Evaluation
    advice: tuple[Advice, ...] = ()
    selection: Selection | None = None
    next: NextStep | None = None
    asked: Setting | None = None
    also: NextStep | None = None

    @property
    def split(self) -> float:
        """The share of the record that is estimation data."""
        return self.plan.split

    @property
    def detrend(self) -> str:
        """What was removed."""
        return self.plan.detrend

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal identify`, ready for JSON."""
        return {
            "read": {**self.record.as_dict(), **self._preparation_summary()},
            **self.evaluation.as_dict(),
            "selection": self.selection.as_dict() if self.selection else None,
            "advice": [vars(a) for a in self.advice],
            "next": self.next.as_dict() if self.next else None,
            "also": self.also.as_dict() if self.also else None,
            "versions": versions(),
        }

    def _preparation_summary(self) -> dict[str, Any]:
        """How the record was prepared and split; what was not asked for is left out."""
        plan, validation = self.plan, self.plan.validation
        split = plan.split if validation is None and not plan.whole else None
        summary: dict[str, Any] = {"split": split, "detrend": plan.detrend}
        if plan.preparation.options():
            summary["prepared"] = list(plan.preparation.options())
        if validation is not None:
            summary["validation"] = validation.as_dict()
        return summary


def named_channels(e: Evaluation, signals: Signals) -> Evaluation:
    """The evaluation of several channels with the names and units of the file."""
    if not e.outputs:
        return e
    names = [
        _distinct_names([s.name for s in role_signals], [s.column for s in role_signals])
        for role_signals in (signals.input, signals.output)
    ]
    outputs = zip(e.outputs, names[1], signals.output, strict=True)
    named = {f"{role}{k}": name for role, each in zip("uy", names, strict=True) for k, name in enumerate(each, 1)}
    return replace(
        e,
        notes=tuple(_with_name(note, named) for note in e.notes),
        inputs=tuple((name, s.unit) for name, s in zip(names[0], signals.input, strict=True)),
        outputs=tuple(replace(output, name=name, unit=s.unit) for output, name, s in outputs),
    )


def _with_name(note: str, named: dict[str, str]) -> str:
    """A note on a channel, which it begins with, with the name of the channel in the file."""
    first, _, rest = note.partition(" was seen from ")
    return f"{named[first]} was seen from {rest}" if rest and first in named else note


def _distinct_names(names: list[str], columns: list[str]) -> list[str]:
    """The names, or the columns where two names are one."""
    return names if len(set(names)) == len(names) else columns


def single_channels(e: Evaluation, section: str) -> list[tuple[str, str, Evaluation]]:
    """What the figures of a section show of several channels: a mark for the name, words, and one input and output.

    "Data" has every channel, "Model output" and "Residual tests" every output, "Model" and "Spectra" the evaluation
    as it is.
    """
    if not e.outputs or section in ("Model", "Spectra"):
        return [("", "", e)]
    ny = len(e.outputs)
    count = max(e.estimation.u.shape[1], ny) if section == "Data" else ny
    return [_single_channel(e, k, section) for k in range(count)]


def _single_channel(e: Evaluation, k: int, section: str) -> tuple[str, str, Evaluation]:
    i, j = min(k, e.estimation.u.shape[1] - 1), min(k, len(e.outputs) - 1)
    single_output = e.outputs[j]
    estimation, validation = (
        one_channel(data, i, j, e.inputs[i], (single_output.name, single_output.unit))
        for data in (e.estimation, e.validation)
    )
    view = replace(
        e,
        estimation=estimation,
        validation=validation,
        estimation_output=e.estimation_output.reshape(e.estimation.N, -1)[:, j],
        validation_output=e.validation_output.reshape(e.validation.N, -1)[:, j],
        estimation_fit=single_output.estimation_fit,
        validation_fit=single_output.validation_fit,
        tests=single_output.tests,
        outputs=(),
    )
    words = f"Output {single_output.name}. "
    words = f"Input {e.inputs[i][0]}, {words[0].lower()}{words[1:]}" if section == "Data" else words
    return f"-{k + 1}", words, view


def one_channel(data: IOData, i: int, j: int, u: tuple[str, str], y: tuple[str, str]) -> IOData:
    """One input and one output of a record, with their names and units."""
    return replace(
        data,
        u=data.u[:, i],
        y=data.y[:, j],
        u_name=u[0],
        y_name=y[0],
        u_unit=u[1],
        y_unit=y[1],
        u_offset=data.u_offset[i],
        y_offset=data.y_offset[j],
        missing=None if data.missing is None else data.missing[:, j],
    )
