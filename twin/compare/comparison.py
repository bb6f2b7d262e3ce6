"""Comparison: a log beside the twin, a saved model or a second log, as finished numbers."""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.criteria import fit_percent
from sysid.base.errors import InputError, unknown
from sysid.base.files import json_value, versions
from sysid.base.rates import same_rate
from sysid.diagnosis.residuals import ResidualTests
from sysid.diagnosis.worth import left_by_run
from sysid.estimation.result import Fit
from sysid.nlarx.result import NlarxFit
from twin.compare.alignment import Alignment, align, opposite_signs, parts, turn_back
from twin.compare.departure import (
    Outlier,
    Regime,
    Repeat,
    Spectrum,
    by_regime,
    has_power,
    noise_of,
    outliers,
    regimes,
    repeat,
    spectrum,
)
from twin.compare.effects import START
from twin.compare.joints import Pair, pairs
from twin.compare.search import Search, Trials, refine
from twin.compare.unseen import unseen
from twin.compare.verdict import Verdict, explain
from twin.follow import Follower
from twin.hardware.linkage import end_angles
from twin.log import Log, check_plausible
from twin.parameters import JOINTS, Parameters

TWIN, MODEL, LOG = "twin", "model", "log"
_LAGS = 25
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Comparison:
    """A log of `joint` and what the twin, a model or another log (`kind`) gives under the same input.

    u (N,) [V], y (N,) [rad] and `other` (N,) [rad] with step Ts [s]; the first `unscored` samples give a model's
    initial state. error = y - other. `regimes` are those of y, and `at` has the samples of each. alignment, verdict:
    of the twin; repeat: of a log; pairs: values of the actuated joint fitted to both, empty if none can be. spectra:
    None for an input without power. `unseen`: what the log does not show of the joint, in words.
    """

    kind: str
    label: str
    joint: str
    u: np.ndarray
    y: np.ndarray
    other: np.ndarray
    Ts: float
    unscored: int
    noise: float
    at: dict[str, np.ndarray]
    regimes: tuple[Regime, ...]
    spectra: tuple[Spectrum, Spectrum] | None
    tests: ResidualTests | None
    pairs: tuple[Pair, ...]
    alignment: Alignment | None = None
    verdict: Verdict | None = None
    repeat: Repeat | None = None
    unseen: tuple[str, ...] = ()

    @property
    def t(self) -> np.ndarray:
        """Time of each sample (N,) [s]."""
        return np.arange(len(self.y)) * self.Ts

    @property
    def error(self) -> np.ndarray:
        """Log less other side (N,) [rad]."""
        return self.y - self.other

    @property
    def outliers(self) -> tuple[Outlier, ...]:
        """Samples that lie far from their neighbours, on either side."""
        return outliers(self.error, self.noise, self.Ts, ~(self.at["rest"] | self.at["end stop"]))

    @property
    def rms(self) -> float:
        """RMS of the error [rad] over the scored samples."""
        return float(np.sqrt(np.mean(self.error[self.unscored :] ** 2)))

    @property
    def fit(self) -> float:
        """Fit of the other side to the log [%]."""
        return fit_percent(self.y[self.unscored :], self.other[self.unscored :])

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal compare`, ready for JSON; without the time series."""
        verdict = None
        if self.verdict is not None:
            found = self.verdict
            verdict = {**asdict(found), "first": found.first, "known": found.known, "explained": found.explained}
        return json_value(
            {
                "kind": self.kind,
                "against": self.label,
                "joint": self.joint,
                "samples": len(self.y),
                "Ts": self.Ts,
                "rms": self.rms,
                "fit": self.fit,
                "noise": self.noise,
                "regimes": [asdict(regime) for regime in self.regimes],
                "alignment": None if self.alignment is None else asdict(self.alignment),
                "verdict": verdict,
                "joint_values": [{**asdict(pair), "apart": pair.apart} for pair in self.pairs],
                "repeat": None if self.repeat is None else asdict(self.repeat),
                "frequency_response": [asdict(spectrum) for spectrum in self.spectra or ()],
                "outliers": [asdict(outlier) for outlier in self.outliers],
                "not_shown": self.unseen,
                "residuals": None if self.tests is None else self.tests.as_dict(),
                "versions": versions(),
            }
        )


@checked
def compare(
    log: Log,
    joint: str,
    parameters: Parameters | None = None,
    apply: Iterable[str] = (),
    without: tuple[str, ...] = (),
    pot_side: str = "link",
    realisation: str = "tendon",
    seconds: float = 60.0,
    seed: int = 1,
    threads: int = 2,
    values: bool = True,
    tell: Tell = lambda text: None,
) -> Comparison:
    """The log beside the twin, driven with its input from its initial state.

    `apply` names the parts of the alignment that the comparison uses (`twin.compare.alignment.PARTS`). Alignment and
    verdict are found on the first `seconds` [s] of the record. `values`: whether the actuated joint is fitted to both
    (the slowest part). `seed` draws the noise of the twin's own log for this. Raises InputError for a joint or a part
    that does not exist, and for a log that is too short or whose numbers
    cannot be of that joint.
    """
    requested_parts, p = parts(apply), parameters or Parameters()
    if joint not in JOINTS:
        raise unknown("joint", joint, JOINTS)
    options: dict[str, Any] = {"without": without, "pot_side": pot_side, "realisation": realisation, "threads": threads}
    check_length(log.N)
    if log.u_unit != "V":
        raise InputError(
            f"the input of the log is in {log.u_unit} and the twin takes volts; scale it to volts of the potentiometer "
            "in the mapping: qpal info FILE --write-map FILE.toml"
        )
    check_plausible(log, joint, p)
    tell("signs")
    signs = opposite_signs(_first(log, seconds), joint, p, **options)
    right = Trials(Follower(_first(turn_back(log, joint, signs), seconds), joint, **options), p)
    verdict: Verdict | None = explain(right, tell)
    tell("alignment")
    alignment = align(right, verdict, signs, requested_parts)
    log = turn_back(log, joint, signs if "sign" in requested_parts else "")
    trials = Trials(Follower(_first(log, seconds), joint, **options), p, alignment.read)
    if signs and "sign" not in requested_parts:  # beside a wrong sign no effect means anything
        verdict = None
    elif alignment.read:
        verdict = explain(trials, tell)
    follower = Follower(log, joint, **options)
    start = _best_start(trials)
    response = Trials(follower, p, alignment.read).rows([{START: start}])[0]
    joint_pairs: tuple[Pair, ...] = ()
    if values:
        tell("the actuated joint on both")
        twin_log = Follower(_first(log, seconds), joint, **options).record(p, seed, start)
        joint_pairs = pairs(_first(log, seconds).io(), twin_log.io(), seed)
    not_shown = unseen(log.u.ravel(), log.y.ravel(), log.Ts, end_angles(p, joint), p["supply_voltage"])
    fields: dict[str, Any] = {"alignment": alignment, "verdict": verdict, "unseen": not_shown}
    return _make_comparison(TWIN, "the twin", joint, log, response, 0, joint_pairs, **fields)


@checked
def compare_model(log: Log, joint: str, fit: Fit | NlarxFit, label: str, tell: Tell = lambda text: None) -> Comparison:
    """The log beside a model, which `sysid.load` read: its free run over the log, in the log's units.

    Raises InputError if the model has another sampling time, or is a model of other signals.
    """
    data = log.io(joint if log.joint else None)
    check_length(data.N)
    if not same_rate(fit.Ts, log.Ts):
        raise InputError(
            f"{label} is a model for a sampling time of {fit.Ts:g} s and the log has {log.Ts:g} s; resample the log, "
            "or identify a model from it: qpal identify"
        )
    tell("the model's free run")
    response = np.asarray(fit.simulate(data), dtype=float).ravel()
    single_log = Log(data.u[:, 0], data.y[:, 0], log.Ts, None, joint, dict(log.meta))
    return _make_comparison(MODEL, label, joint, single_log, response, fit.n_init, ())


@checked
def compare_log(log: Log, second: Log, joint: str, label: str, tell: Tell = lambda text: None) -> Comparison:
    """Two logs of one experiment: how well it repeats. Raises InputError if their inputs differ."""
    first_data, second_data = (record.io(joint if record.joint else None) for record in (log, second))
    check_length(min(first_data.N, second_data.N))
    tell("the second log")
    repetition = repeat(first_data, second_data, label)
    n = min(first_data.N, second_data.N)
    single_log = Log(first_data.u[:n, 0], first_data.y[:n, 0], log.Ts, None, joint, dict(log.meta))
    return _make_comparison(LOG, label, joint, single_log, second_data.y[:n, 0], 0, (), repeat=repetition)


def check_length(N: int) -> None:
    """Raises InputError for a log that is too short to compare."""
    if N <= 2 * _LAGS:
        raise InputError(f"the log has {N} samples; a comparison needs more than {2 * _LAGS}: record a longer one")


def _first(log: Log, seconds: float) -> Log:
    n = max(min(log.N, round(seconds / log.Ts)), 2 * _LAGS + 1)
    meta = dict(log.meta)
    if "filled" in meta:
        meta["filled"] = [k for k in meta["filled"] if k < n]
    return Log(log.u[:n], log.y[:n], log.Ts, None, log.joint, meta)


def _best_start(trials: Trials) -> float:
    """Angle of the drive [rad] at the first sample that fits the log best, all else nominal."""
    base = Search("", ())
    refine(trials, base, trials.follower.y)
    return base.state.get(START, trials.knobs[START].nominal)


def _make_comparison(
    kind: str,
    label: str,
    joint: str,
    log: Log,
    response: np.ndarray,
    first_scored: int,
    joint_pairs: tuple[Pair, ...],
    **fields: Any,
) -> Comparison:
    """The comparison of `log` with the response `other`, by regime and frequency; raises InputError if not finite."""
    if not np.isfinite(response).all():
        raise InputError(f"{label} gives no finite angles under this input; try other parameters or another model")
    u, y = np.asarray(log.u, dtype=float).ravel(), np.asarray(log.y, dtype=float).ravel()
    samples = regimes(y, log.Ts)
    scored_samples = {name: mask[first_scored:] for name, mask in samples.items()}
    error = (y - response)[first_scored:]
    tests = left_by_run(u[first_scored:], y[first_scored:], response[first_scored:])
    spectra = (spectrum(u, y, log.Ts), spectrum(u, response, log.Ts)) if has_power(u) else None
    return Comparison(
        kind,
        label,
        joint,
        u,
        y,
        response,
        log.Ts,
        first_scored,
        noise_of(y),
        samples,
        by_regime(error, scored_samples),
        spectra,
        tests,
        joint_pairs,
        **fields,
    )


@dataclass(frozen=True)
class TwinResponse:
    """Time t (N,) [s], input u (N,) [V], the log's angle y and the twin's (N,) [rad] of one joint."""

    joint: str
    t: np.ndarray
    u: np.ndarray
    y: np.ndarray
    twin: np.ndarray


def twin_response(log: Log, joint: str, parameters: Parameters | None = None, pot_side: str = "link") -> TwinResponse:
    """The twin under the input of the log; raises InputError for a joint that the log does not have, and for
    numbers that cannot be of it."""
    follower, p = Follower(log, joint, pot_side=pot_side), parameters or Parameters()
    check_plausible(log, joint, p)
    trials, search = Trials(follower, p), Search("", ())
    refine(trials, search, follower.y, rounds=2)
    (row,) = trials.rows([search.state])
    return TwinResponse(joint, log.t, follower.u, follower.y, row)
