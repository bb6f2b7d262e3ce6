"""A servo's logs from goal to angle: models with more and more physics, fitted on twelve logs, run on four held out.

    python scripts/servo_goal.py FOLDER [--figure FILE.png]

FOLDER holds the 16 logs of an XL330 with a pendulum (see `sysid.bench.scenarios.real`). The gain of the servo's loop
is that of each log; one gain is held out. No model sees the duty or the supply of a log. The model with least BIC on
the twelve logs is marked. The first 50 samples of a test give its initial state and are not scored.
"""

import argparse
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

import sysid
from sysid import IOData
from sysid.bench.scenarios.real import FULL_DUTY, HELD_OUT, servo_goals
from sysid.blocks import ServoMotor
from sysid.structures import servo_joint

UNSCORED = 50
# Duty per rad at gain 400: 4096 steps a turn, gain / 256 (as the logs of every gain show, within 1 %), of full duty.
KP = HELD_OUT / 256.0 * 4096.0 / (2.0 * math.pi) / FULL_DUTY
MODELS: dict[str, dict[str, Any]] = {
    "dry friction, pendulum": {},
    "and friction by load": {"loss": True},
    "and a supply that sags": {"loss": True, "sags": True},
    "and Stribeck friction": {"loss": True, "sags": True, "stribeck": True},
}


def fit_loop(train: IOData, seed: int = 0, **options: bool) -> sysid.Fit:
    """A servo joint with the loop's gain known."""
    motor = ServoMotor(load=0, periodic=1, stops=False, scheduled=True, updates=2, **options)
    return sysid.fit(servo_joint(motor, play=False, fixed={"motor.kp": KP}), train, search="lm", starts=3, seed=seed)


def errors(fit: sysid.Fit, tests: list[tuple[str, IOData]]) -> list[np.ndarray]:
    """Scored free-run errors of each held-out log [rad]."""
    return [(fit.simulate(data, UNSCORED).ravel() - data.y[:, 0])[UNSCORED:] for _, data in tests]


def split(folder: Path) -> tuple[IOData, list[tuple[str, IOData]]]:
    """The twelve training logs, and name and record of the four held-out ones."""
    logs = servo_goals(folder)
    train = IOData.merge(*(data for kp, _, data in logs if kp != HELD_OUT))
    return train, [(name, data) for kp, name, data in logs if kp == HELD_OUT]


def draw(path: Path, fit: sysid.Fit, tests: list[tuple[str, IOData]]) -> None:
    """The four held-out logs beside the model."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5.2), layout="constrained")
    for ax, (name, data) in zip(figure.subplots(2, 2).ravel(), tests, strict=True):
        t, run = np.arange(data.N) * data.Ts, fit.simulate(data, UNSCORED).ravel()
        ax.plot(t, np.degrees(data.u[:, 0]), color="0.75", linewidth=1, label="goal")
        ax.plot(t, np.degrees(data.y[:, 0]), color="0.2", label="servo")
        ax.plot(t, np.degrees(run), color="tab:red", linestyle="--", label="servo joint")
        error = np.degrees(np.sqrt(np.mean((run - data.y[:, 0])[UNSCORED:] ** 2)))
        ax.set(title=f"{name.replace('_', ' ')}: {error:.1f} deg RMS", ylabel="angle [deg]", xlabel="time [s]")
    figure.axes[0].legend()
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    train, tests = split(given.folder)
    found = {}
    print(
        "| free run from goal to angle [rad] | BIC | RMS | mean error | " + " | ".join(n for n, _ in tests) + " | s |"
    )
    for name, options in MODELS.items():
        began = time.perf_counter()
        fit = found[name] = fit_loop(train, **options)
        parts = errors(fit, tests)
        all_ = np.concatenate(parts)
        shown = [f"{fit.criteria.bic:.0f}", f"{np.sqrt(np.mean(all_**2)):.4f}", f"{np.abs(all_).mean():.4f}"]
        shown += [f"{np.sqrt(np.mean(part**2)):.3f}" for part in parts]
        print(f"| {name} | {' | '.join(shown)} | {time.perf_counter() - began:.1f} |", flush=True)
    best = min(found, key=lambda name: found[name].criteria.bic)
    values = dict(zip(found[best].model.names, found[best].theta.round(5).tolist(), strict=True))
    print(f"least BIC: {best}", values)
    if given.figure is not None:
        draw(given.figure, found[best], tests)
