"""Write tests/saved/v<N>: small fits saved by this version of the code, each with a record and the runs it gives.

Run once when the file version rises, before anything is renamed; the files are never written again. Usage:
python scripts/saved_fits.py tests/saved/v1
"""

import json
import sys
from pathlib import Path

import numpy as np

import sysid
from sysid import IOData, Objective, Options
from sysid.blocks import (
    CoastingPlay,
    CubicSpline,
    Delay,
    FrictionLag,
    LimitedIntegrator,
    Motor,
    Play,
    ProfiledMotor,
    SigmoidNetwork,
    UnitGain,
    WaveletNetwork,
)
from sysid.model.chain import Chain
from sysid.structures import actuated_joint, hammerstein_wiener, output_error, wiener_hammerstein

N, Ts = 200, 0.1
FEW = Options(max_iterations=4)


def nonlinear(seed: int, channels: int = 1, samples: int = N) -> IOData:
    """A saturation, a filter and a tanh with noise, the same for each output but for its gain."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, (samples // 4, channels)), 4, axis=0).round(4)
    w = np.clip(u.sum(axis=1), -1, 1.2)
    x = np.convolve(w, 0.3 * 0.8 ** np.arange(40))[:samples]
    gains = 1.0 + np.arange(channels)
    y = np.tanh(0.8 * np.roll(x, 1))[:, None] * gains + 0.02 * rng.normal(size=(samples, channels))
    return IOData(u, y.round(4), Ts)


def joint(seed: int) -> IOData:
    """A motor with dry friction that runs into both ends."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-6, 6, N // 10), 10).round(4)
    x = np.empty(N)
    position = 0.2
    for k, v in enumerate(u):
        x[k] = position
        position = min(max(position + (0.02 * (v - np.sign(v)) if abs(v) > 1 else 0.0), -1.0), 1.0)
    return IOData(u, (x + 0.005 * rng.normal(size=N)).round(4), Ts)


def cases() -> dict[str, tuple[object, IOData, dict]]:
    """Model, record and further arguments of `sysid.fit` by name."""
    gappy = nonlinear(7)
    gappy = IOData(gappy.u, gappy.y, Ts, missing=np.isin(np.arange(N), [20, 21, 90]))
    travel = {"knots": 4, "driver": "dead_zone_saturation"}
    return {
        "piecewise_linear": (hammerstein_wiener(2, 2, 1, "saturation", "piecewise_linear"), nonlinear(1), {}),
        "networks": (hammerstein_wiener(1, 2, 1, CubicSpline(5), WaveletNetwork(3, 2)), nonlinear(2), {}),
        "fixed_bounds": (
            hammerstein_wiener(
                2, 2, 1, SigmoidNetwork(4), "polynomial",
                fixed={"output.c1": -0.2}, bounds={"linear.b0": (0.01, 4.0)},
            ),
            nonlinear(3),
            {},
        ),
        "dead_zones": (hammerstein_wiener(1, 1, 1, "dead_zone_saturation", "dead_zone"), nonlinear(4), {}),
        "output_error": (output_error(2, 3, 1), nonlinear(5), {"search": "lm"}),
        "wiener_hammerstein": (wiener_hammerstein(1, 1, 1, middle="polynomial"), nonlinear(6), {"starts": 2}),
        "objective": (
            hammerstein_wiener(2, 2, 1, "piecewise_linear", "polynomial"),
            gappy,
            {
                "objective": Objective(
                    huber_threshold=1.345, ridge=1e-3, nominal={"linear.f1": -0.8}, weights=(3.0,), curvature_weight=0.5
                )
            },
        ),
        "several_outputs": (
            hammerstein_wiener(1, 1, 1, ["saturation", "dead_zone"], "polynomial", nu=2, ny=2),
            nonlinear(8, channels=2),
            {"objective": Objective(weights=(1.0, 10.0))},
        ),
        "several_experiments": (
            hammerstein_wiener(2, 2, 1, "saturation", UnitGain()),
            IOData.merge(nonlinear(9, samples=120), nonlinear(10, samples=80)),
            {},
        ),
        "joint_stribeck": (
            actuated_joint(motor=Motor(load=3, loss=True, stribeck=True, substeps=2), **travel),
            joint(11),
            {},
        ),
        "joint_jams": (
            actuated_joint(motor=Motor(load=1, jams=True), play=CoastingPlay(), driver_step=0.25, knots=3),
            joint(12),
            {},
        ),
        "profile": (
            Chain((ProfiledMotor(knots=3, low=-1.0, high=1.0, role="motor"), Play(role="play"))),
            joint(13),
            {"start": [3.0, 40.0, 40.0, 0.9, 1.0, 1.1, 1.2, 1.1, 1.0, 0.2, 0.0, 0.01, 0.0]},
        ),
        "integrator": (
            Chain(
                (
                    Delay(role="delay"), FrictionLag(role="friction"),
                    LimitedIntegrator(role="stops"), Play(role="play"),
                ),
                fixed={"friction.gain": 0.02},
            ),
            joint(14),
            {"start": [0.4, 0.02, 0.2, 0.02, 0.3, 0.0, 1.0, -1.0, 1.0, 0.2, 0.01, 0.0]},
        ),
    }  # fmt: skip


def write(folder: Path) -> None:
    """Every case into `folder`: <name>.json is the fit, <name>.run.json the record and what the fit makes of it."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, (model, data, options) in cases().items():
        fit = sysid.fit(model, data, **{"search": "auto", "starts": 1, "options": FEW, **options})
        fit.save(folder / f"{name}.json")
        record = {"u": data.u.tolist(), "y": data.y.tolist(), "Ts": data.Ts, "lengths": list(data.lengths)}
        if data.missing is not None:
            record["missing"] = np.flatnonzero(data.missing).tolist()
        runs = {
            "from_rest": fit.simulate(data.u).tolist(),
            "on_record": fit.simulate(data).tolist(),
            "fit_percent": fit.fit_percent(data),
            "poles": [[z.real, z.imag] for z in fit.poles.tolist()],
        }
        (folder / f"{name}.run.json").write_text(json.dumps({"record": record, **runs}) + "\n", encoding="utf-8")
        print(f"{name}: {fit.fit_percent(data):.2f} %, {len(fit.theta)} parameters")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
