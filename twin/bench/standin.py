"""A stand-in for a real leg: a twin with hidden parameters, the other realisation and effects that the twin lacks."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from twin.experiment import SETTLE, Experiment
from twin.log import Log
from twin.parameters import JOINTS, Parameters
from twin.plant import slots
from twin.plant.stepping import step

TS = 0.02  # [s] of the capture
DUTY = 255  # counts of full duty
# Effects of the stand-in that a calibrated twin is denied: its calibration runs without them.
LACKS = ("nonlinearity", "sag", "stribeck")
# Factors, or shifts for those with (low, high, "+"), of what is hidden, drawn uniformly.
RANGES: dict[str, tuple[Any, ...]] = {
    "retracted_length": (0.98, 1.02),
    "stroke": (0.97, 1.03),
    "lower": (-0.05, 0.05, "+"),
    "upper": (-0.05, 0.05, "+"),
    "no_load_speed": (0.7, 1.3),
    "coulomb": (0.6, 1.4),
    "asymmetry": (-0.3, 0.1, "+"),  # of a nominal 0.1
    "rotor_inertia": (0.6, 1.6),
    "load_friction": (0.6, 1.4),
    "backlash": (0.2, 1.8),
    "stribeck": (0.5, 1.5),
    "stribeck_speed": (0.7, 1.4),
    "delay": (0.0, 0.03, "+"),
}
COMMON: dict[str, tuple[Any, ...]] = {
    "dead_band": (-0.15, 0.15, "+"),
    "supply_resistance": (0.5, 2.0),
    "pot_linearity": (0.5, 1.5),
}


def draw_parameters(joint: str, seed: int) -> Parameters:
    """Parameters of the stand-in `seed`, drawn over `RANGES` and `COMMON`."""
    rng, nominal = np.random.default_rng([seed, 77, JOINTS.index(joint)]), Parameters()
    values = {}
    for short, (low, high, *kind) in {**RANGES, **COMMON}.items():
        change = rng.uniform(low, high)
        name = f"{joint}.{short}" if f"{joint}.{short}" in nominal.values else short
        if name in nominal.values:
            values[name] = nominal[name] + change if kind else nominal[name] * change
    values["delay"] = round(values["delay"], 2)  # whole periods of the board
    return nominal.replace(values)


@dataclass(frozen=True)
class StandIn:
    """The rig of `joint` with hidden parameters `seed`; `same` gives it the twin's structure, `LACKS` included."""

    joint: str
    seed: int
    same: bool = False
    parameters: Parameters = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", draw_parameters(self.joint, self.seed))

    @property
    def missing(self) -> tuple[str, ...]:
        """Imperfections that neither the twin nor a stand-in of the same structure has."""
        return LACKS

    def log(self, excitation: str, duration: float, draw: int, **options: float) -> Log:
        """A record of the rig; `y_true` is its reading without noise, converter and lost samples."""
        experiment = Experiment(
            self.joint,
            excitation,
            duration,
            TS,
            seed=1000 * self.seed + draw,
            without=LACKS if self.same else (),
            parameters=self.parameters,
            options=options,
            realisation="tendon" if self.same or self.joint == "shoulder" else "closed_loop",
        )
        u = np.round(experiment.commands() / 12.0 * DUTY) / DUTY * 12.0
        run = experiment.prepare(u=u)
        slots_of_run = step([run], TS, SETTLE)[0]
        if not self.same:
            slots_of_run = slots_of_run.copy()
            slots_of_run[:, :, slots.READING] += self._track(slots_of_run[:, :, slots.READING])
        return replace(experiment.record(run, slots_of_run), meta={})

    def _track(self, angle: np.ndarray) -> np.ndarray:
        """A second deviation of the potentiometer's track, of another shape than the twin can have [rad]."""
        rng = np.random.default_rng([self.seed, 99])
        waves, phases = rng.uniform(2.0, 6.0, 2), rng.uniform(0.0, 2.0 * np.pi, 2)
        return np.deg2rad(0.1) * sum(np.sin(w * angle * 2.0 + f) for w, f in zip(waves, phases, strict=True))

    def calibration(self) -> list[Log]:
        """60 s to calibrate from: the ends at full voltage, then random levels."""
        half = {"shoulder": 2.0}.get(self.joint, 7.5)
        return [
            self.log("sweep", 30.0, 1, half_period=half, jitter=0.2, shrink=0.25, first=0.6),
            self.log("aprbs", 30.0, 2),
        ]

    def fresh(self) -> Log:
        """A held-out record with another excitation."""
        low, high = (0.1, 1.0) if self.joint == "shoulder" else (0.05, 0.3)
        return self.log("chirp", 60.0, 3, f_min=low, f_max=high)
