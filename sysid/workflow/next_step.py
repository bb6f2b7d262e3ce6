"""What to try next where a fit is poor: one sentence and one command, by rules on the fit and on the record."""

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.base.errors import InputError
from sysid.data.preprocess import quick_start
from sysid.data.record import IOData
from sysid.workflow.evaluation import JOINT, NLARX, OVERFITTED, Setting
from sysid.workflow.extrapolation import extrapolated_signals
from sysid.workflow.record import OWN

if TYPE_CHECKING:
    from sysid.workflow.identification import Identification

POOR = 80.0  # [%] in validation; a fit below it that leaves more than noise should be tried again
STARTS, MOST_STARTS = 5, 10  # with fewer, another start may find more; from the second on it rarely does
MUCH = 0.2  # of the validation part
SPLITS = (0.6, 0.7, 0.8)
LINEAR = ("output_error",)
PLAIN = "hammerstein_wiener"


@dataclass(frozen=True)
class NextStep:
    """Why to go on, and the command that does."""

    why: str
    command: str

    def sentence(self) -> str:
        """Both, as the report and the console say them."""
        return f"Next: {self.why}; try: {self.command}"


def next_step(result: "Identification") -> NextStep | None:
    """The next thing to try; None where the fit is good, or what it leaves is noise.

    A fit is poor below POOR in validation, unless its residuals are white and independent of the input: noise then
    sets the limit. A better fit has a next step where its search did not converge, or where its residuals are not
    white; of an actuated joint they rarely are, and no other structure does better.
    """
    e = result.evaluation
    noise_alone = e.tests is not None and e.tests.white and e.tests.independent
    poor = not e.validation_fit >= POOR and not noise_alone
    rules: tuple[_Rule, ...] = ()
    if poor:
        rules = (_unseen, _ends, _delay, _focus, _coverage, _nonlinear, _more_starts, _search_structures, _other_kind)
    elif not e.fit.stop.converged:
        rules = (_more_starts,)
    elif e.tests is not None and not e.tests.white and e.setting.structure != JOINT:
        rules = (_nonlinear, _ends, _search_structures)
    return next((step for rule in rules if (step := rule(result)) is not None), None)


_Rule = Callable[["Identification"], NextStep | None]


def _ends(result: "Identification") -> NextStep | None:
    """A record that stands at its ends, and a model without end stops; a structure search has tried one with them.

    A linear model gets its maps first, which are simpler than a joint and may saturate.
    """
    structure = result.evaluation.setting.structure
    rests = any(a.topic == "rest" and a.severity != "fine" for a in result.advice)
    if not rests or result.selection is not None or structure == JOINT or (structure in LINEAR and _bends(result)):
        return None
    why = "the output rests at its ends, and this model has no end stops"
    return NextStep(why, command(result, structure=JOINT))


def _delay(result: "Identification") -> NextStep | None:
    """Orders that cannot hold the delay that the record shows."""
    s = result.evaluation.setting
    found = [a.value for a in result.advice if a.topic == "delay" and np.isfinite(a.value)]
    if s.structure == JOINT or result.selection is not None or not found:
        return None
    nk = int(found[0])
    if s.nk <= nk < s.nk + s.nb:
        return None
    why = f"the output answers after {nk} sample(s), and the model's delay is {s.nk}"
    return NextStep(why, command(result, nk=nk))


def _focus(result: "Identification") -> NextStep | None:
    """A nonlinear ARX model that was fitted one step ahead and is asked to run free."""
    if result.evaluation.setting.structure != NLARX or result.evaluation.setting.focus != "prediction":
        return None
    return NextStep("the model was fitted one step ahead and runs free badly", command(result, focus="simulation"))


def _unseen(result: "Identification") -> NextStep | None:
    """A validation part of which much lies outside the range of the part that was fitted."""
    return _coverage(result) if _outside(result.evaluation.estimation, result.evaluation.validation) > MUCH else None


def _coverage(result: "Identification") -> NextStep | None:
    """A validation part that leaves the range of the part that was fitted, and a split that mends this."""
    e = result.evaluation
    if not extrapolated_signals(e.estimation, e.validation):
        return None
    most = _outside(e.estimation, e.validation) / 4
    for split in SPLITS:
        if split > result.split and _outside_after(result, split) <= most:
            why = "the validation part leaves the range that was fitted to, and a longer first part covers more of it"
            return NextStep(why, command(result, split=split))
    return None


def _outside(estimation: IOData, validation: IOData) -> float:
    """The share of validation samples outside the range of the estimation part, of the signal that leaves it most."""
    seen, new = (np.column_stack([part.u, part.y]) for part in (estimation, validation))
    return float(np.mean((new < seen.min(axis=0)) | (new > seen.max(axis=0)), axis=0).max())


def _outside_after(result: "Identification", split: float) -> float:
    try:
        return _outside(*quick_start(result.record.data, split, result.detrend))
    except InputError:  # too short for this split
        return np.inf


def _nonlinear(result: "Identification") -> NextStep | None:
    """A linear model of a record that bends."""
    if result.evaluation.setting.structure not in LINEAR or result.selection is not None or not _bends(result):
        return None
    return NextStep("the record is nonlinear, and this model is linear", command(result, structure=PLAIN))


def _bends(result: "Identification") -> bool:
    return any(a.topic == "nonlinearity" and a.severity == "note" and a.action for a in result.advice)


def _more_starts(result: "Identification") -> NextStep | None:
    """A search that stopped early, or that began from few points."""
    stop, starts = result.evaluation.fit.stop, result.evaluation.setting.starts
    if starts >= (STARTS if stop.converged else MOST_STARTS):
        return None
    why = "the search began from few points" if stop.converged else "the search did not converge"
    return NextStep(f"{why} ({starts} starts)", command(result, starts=STARTS if stop.converged else MOST_STARTS))


def _search_structures(result: "Identification") -> NextStep | None:
    """Another structure or size, by a search that judges candidates on data that they were not fitted to."""
    e = result.evaluation
    if result.selection is not None:
        return None
    why = "this structure does not explain the record"
    if e.estimation_fit - e.validation_fit > OVERFITTED:
        why = "the model is too large for this record"
    elif e.validation_fit >= POOR:
        why = "the residuals are not white, so the model leaves something out"
    return NextStep(why, command(result, structure="auto", starts=2))


def _other_kind(result: "Identification") -> NextStep | None:
    """No block model was found: a nonlinear ARX model supposes no blocks."""
    return NextStep("no structure of blocks explains the record", command(result, structure=NLARX))


def command(
    result: "Identification",
    structure: str | None = None,
    starts: int | None = None,
    split: float | None = None,
    nk: int | None = None,
    focus: str | None = None,
) -> str:
    """The command that made `result`, with changes; a new `structure` takes its own default orders and maps."""
    record, s = result.record, result.evaluation.setting
    auto = result.selection is not None and structure is None
    same = structure is None and not auto
    name = "auto" if auto else structure or s.structure
    words = ["qpal", "identify", str(record.path), *_columns(result), "--structure", name]
    if same:
        words += _kept(s, s.nk if nk is None else nk, focus)
    joints = JOINT in (name, s.structure)  # such a model has its own search, and nothing is removed from its record
    for option, value, default in (
        ("--search", "auto" if structure or joints else s.search, "auto"),
        ("--split", f"{split or result.split:g}", "0.5"),
        ("--detrend", "mean" if joints else result.detrend, "mean"),
        ("--starts", str(starts or (STARTS if structure else s.starts)), str(STARTS)),
        ("--seed", str(s.seed), "0"),
    ):
        words += [] if value == default else [option, value]
    return shlex.join(words)


def _columns(result: "Identification") -> list[str]:
    """The options that read the same columns; none for those that are found without."""
    r = result.record
    words = [] if r.notes else ["--input", r.input, "--output", r.output]
    if r.time is None:
        words += ["--ts", f"{r.data.Ts:.9g}"]
    elif r.time != OWN["time"]:
        words += ["--time", r.time]
    return words


def _kept(s: Setting, nk: int, focus: str | None) -> list[str]:
    """Options of a setting's own structure."""
    words = []
    if s.orders:
        words += ["--orders", ",".join(str(n) for n in ({**s.orders, "nk": nk}).values())]
    for option, value in (("--input-map", s.input_map), ("--output-map", s.output_map)):
        words += [] if value is None else [option, value]
    if s.structure == NLARX and (focus or s.focus) != "prediction":
        words += ["--focus", focus or s.focus]
    if s.structure == JOINT:
        words += [] if s.driver_step is None else ["--driver-step", f"{s.driver_step:g}"]
        words += ["--sensor-linearity", f"{s.sensor_linearity:g}"] if s.sensor_linearity else []
    return words
