"""The paper's protocol on the twin: three joints, three models each, compared with the paper and the truth.

Guni and Irawan, JEECIE 1(10), 2016: the joint is swept between its ends by a voltage, sampled every 0.1 s; means
removed, first half for estimation, second half for validation (sections III.B and IV). Structures, searches and
results are those of section IV.D; the poles are the roots of its equations (7), (9) and (11).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import twin
from sysid.base.errors import InputError
from sysid.base.files import versions
from sysid.base.quantities import number
from sysid.data.preprocess import quick_start
from sysid.structures import HammersteinWiener, NonlinearArx
from sysid.workflow.evaluation import evaluate
from sysid.workflow.results import Evaluation
from sysid.workflow.setting import Setting
from twin.log import Log
from twin.studies import ablation, beyond
from twin.studies.ablation import Ablation
from twin.studies.beyond import JointTrials
from twin.truth import Truth

TS = 0.1  # [s]
DURATION = 250.0  # [s]: 2 x 1,250 samples, as the paper's ratio of FPE to loss indicates
SHORTEST = 60.0  # [s]: with less, the halves have too few samples for the largest of the models
TRUTH_TOLERANCE = 1e-3  # |z|, between the compiled model's poles and the closed form
NLARX = Setting(NonlinearArx(2, 2, 1), "lm", starts=3)  # with a wavelet network, fitted one step ahead
DEFAULT = Setting(HammersteinWiener(2, 3, 1, "piecewise_linear", "piecewise_linear"), "auto", knots=0)


@dataclass(frozen=True)
class PaperRow:
    """Settings and results of the paper for one joint."""

    title: str
    setting: Setting
    validation_fit: float
    fpe: float
    loss: float
    poles: tuple[float, ...]


PAPER: dict[str, PaperRow] = {
    "shoulder": PaperRow(
        "Joint 1 shoulder",
        Setting(HammersteinWiener(3, 3, 1, "sigmoid_network", "piecewise_linear"), "lm", knots=0),
        71.06,
        0.054,
        0.04841,
        (0.95969, -0.80956, -0.64523),
    ),
    "thigh": PaperRow(
        "Joint 2 thigh",
        Setting(HammersteinWiener(2, 2, 1, "saturation", "piecewise_linear"), "auto", knots=0),
        79.14,
        0.101,
        0.09762,
        (0.99463, 0.98137),
    ),
    "shank": PaperRow(
        "Joint 3 shank",
        Setting(HammersteinWiener(3, 1, 3, "saturation", "piecewise_linear"), "gna", knots=0),
        71.35,
        0.1271,
        0.1228,
        (0.9848, 0.0, 0.0, 0.0, 0.0),
    ),
}


def steps(ablated: bool = False) -> int:
    """Number of steps that `run` announces."""
    return (4 + beyond.STEPS + (ablation.STEPS if ablated else 0)) * len(PAPER)


@dataclass(frozen=True)
class JointResult:
    """One joint: its log, its truth, its three models, and the ceiling set by noise.

    `ceiling` [%] is the fit of the twin's noise-free output against its measured output on the validation half: no
    model can be expected to do better. `beyond` has the fits of an actuated joint to the same record and to one that
    does not repeat itself; `ablation` has the losses without parts of it, if requested.
    """

    joint: str
    paper: PaperRow
    log: Log
    truth: Truth
    nlarx: Evaluation
    default: Evaluation
    final: Evaluation
    ceiling: float
    beyond: JointTrials
    ablation: tuple[Ablation, ...] = ()

    @property
    def truth_error(self) -> float:
        """Largest distance in z between the poles of the compiled model and the closed form."""
        return float(np.max(np.abs(self.truth.poles - self.truth.closed_form_poles)))


@dataclass(frozen=True)
class Check:
    """A statement that must hold, and the result."""

    statement: str
    found: str
    holds: bool


@dataclass(frozen=True)
class ProtocolResult:
    """The results of the protocol, ready for display."""

    seed: int
    duration: float
    joints: tuple[JointResult, ...]
    seconds: float

    @property
    def checks(self) -> tuple[Check, ...]:
        """Statements that must hold in every run."""
        results = []
        for r in self.joints:
            for name, e in (("default", r.default), ("final", r.final)):
                largest = float(np.max(np.abs(e.poles), initial=0.0))
                statement = f"{r.joint}: poles of the {name} model inside the unit circle"
                results.append(Check(statement, f"largest |z| {largest:.6f}", e.stable))
            results.append(
                Check(
                    f"{r.joint}: poles of the compiled twin equal the closed form within {TRUTH_TOLERANCE:g}",
                    f"largest distance {number(r.truth_error, 2)}",
                    r.truth_error <= TRUTH_TOLERANCE,
                )
            )
        return tuple(results)

    @property
    def holds(self) -> bool:
        """Whether every check holds."""
        return all(check.holds for check in self.checks)

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal reproduce`, ready for JSON."""
        return {
            "seed": self.seed,
            "duration": self.duration,
            "Ts": TS,
            "joints": {r.joint: _joint_summary(r) for r in self.joints},
            "beyond": {r.joint: r.beyond.as_dict() for r in self.joints},
            "ablation": {r.joint: {a.record: a.as_dict() for a in r.ablation} for r in self.joints if r.ablation},
            "checks": [vars(check) for check in self.checks],
            "holds": self.holds,
            "seconds": self.seconds,
            "versions": versions(),
        }


def run(
    seed: int = 0,
    duration: float = DURATION,
    announce: Callable[[str], None] = lambda name: None,
    ablated: bool = False,
) -> ProtocolResult:
    """Runs the protocol; `announce` receives the name of each step before it begins.

    `ablated`: see `twin.studies.ablation`.
    """
    if not SHORTEST <= duration < float("inf"):
        raise InputError(
            f"--duration is {duration:g} s; give at least {SHORTEST:g} s, because half of it must have enough samples"
        )
    began = time.perf_counter()
    joints = tuple(_run_joint(joint, seed, duration, announce, ablated) for joint in PAPER)
    return ProtocolResult(seed, duration, joints, time.perf_counter() - began)


def _run_joint(joint: str, seed: int, duration: float, announce: Callable[[str], None], ablated: bool) -> JointResult:
    """The result of one joint: its log, three models, ceiling, and what goes beyond the paper."""
    announce(f"{joint}: experiment")
    log = twin.Experiment(joint=joint, excitation="sweep", duration=duration, Ts=TS, seed=seed).run()
    estimation, validation = quick_start(log.io())
    announce(f"{joint}: default NLARX model")
    nlarx = evaluate(NLARX, estimation, validation)
    announce(f"{joint}: default Hammerstein-Wiener model")
    default = evaluate(DEFAULT, estimation, validation)
    announce(f"{joint}: the paper's final model")
    final = evaluate(PAPER[joint].setting, estimation, validation)
    trials = beyond.run(joint, PAPER[joint].setting, log, final, seed, duration, announce)
    return JointResult(
        joint=joint,
        paper=PAPER[joint],
        log=log,
        truth=twin.truth(joint, TS),
        nlarx=nlarx,
        default=default,
        final=final,
        ceiling=beyond.ceiling(log, slice(estimation.N + final.fit.n_init, None)),
        beyond=trials,
        ablation=ablation.run(trials, PAPER[joint].setting, announce) if ablated else (),
    )


def _joint_summary(r: JointResult) -> dict[str, Any]:
    """One joint, ready for JSON."""
    paper = r.paper
    return {
        "nlarx": r.nlarx.as_dict(),
        "default": r.default.as_dict(),
        "final": r.final.as_dict(),
        "ceiling": r.ceiling,
        "paper": {
            "fit_percent": {"validation": paper.validation_fit},
            "fpe": paper.fpe,
            "loss": paper.loss,
            "poles": list(paper.poles),
            "setting": paper.setting.as_dict(),
        },
        "truth": r.truth.as_dict(),
        "truth_error": r.truth_error,
        "log": dict(r.log.meta),
    }
