"""Ground truth of one joint: what an identifier should find in the twin's logs."""

from dataclasses import asdict, dataclass
from typing import Any

import mujoco
import numpy as np

from sysid.errors import InputError
from twin.geometry import end_angles, linkage, middle
from twin.leg import BENCH_LEG, bench, check_joint
from twin.motor import motor
from twin.parameters import Parameters

LINEAR = ("end_stops", "backlash", "noise", "adc", "gravity")  # what the linearisation leaves out, with dry friction


@dataclass(frozen=True)
class Truth:
    """Voltage-to-angle channel of a bench joint at mid stroke, and the levels of its imperfections.

    The channel is an integrator behind a lag. `poles` (2,) in z at Ts come from the compiled model as it is stepped,
    `closed_form_poles` (2,) from motor and load constants taken through the same integration step; `poles_s` and
    `closed_form_poles_s` [1/s] are log(z) / Ts. `continuous_pole` [1/s] is the lag's pole -damping / inertia before any
    time step (the implicit step of h = 1 ms shows a pole s as -log(1 - s h) / h, about 1 % slower). Dry friction, play,
    end stops and gravity are out of the linearisation, viscous friction is in.

    gain and closed_form_gain [rad/s per V]: speed per volt once the lag has settled. end_angles [rad]: travel of the
    drive side; the link rests up to backlash / 2 beyond. backlash [rad]: whole width. breakaway_voltage [V]: what just
    starts the joint from rest at mid stroke towards smaller and larger angles, gravity and dry friction together.
    friction holds the levels, at rod or joint.
    """

    joint: str
    Ts: float
    operating_point: float
    poles: np.ndarray
    poles_s: np.ndarray
    gain: float
    closed_form_poles: np.ndarray
    closed_form_poles_s: np.ndarray
    closed_form_gain: float
    continuous_pole: float
    end_angles: tuple[float, float]
    backlash: float
    breakaway_voltage: tuple[float, float]
    friction: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """The same as plain numbers and lists, for JSON; poles as [re, im]."""
        return {k: _plain(v) for k, v in asdict(self).items()}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [[float(x.real), float(x.imag)] for x in value]
    return list(value) if isinstance(value, tuple) else value


def truth(joint: str, Ts: float = 0.1, parameters: Parameters | None = None) -> Truth:
    """The truth about `joint` sampled every `Ts` [s]; raises InputError for a joint or Ts that does not exist."""
    check_joint(joint)
    p = parameters or Parameters()
    model, data = _linear_bench(joint, p)
    h = model.opt.timestep
    steps = Ts / h if isinstance(Ts, int | float) and 0 < Ts < np.inf else 0.0
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6 * steps:
        raise InputError(f"Ts is {Ts!r} s; give a whole number of milliseconds, the step of the simulation")
    poles, gain = channel(model, data, round(steps))
    damping, inertia, force_per_volt = closed_form(joint, p, model, data)
    lag = (1 + h * damping / inertia) ** -round(steps)  # implicit Euler: v+ = v - h damping / inertia v+
    closed = np.array([1.0, lag], dtype=complex)
    return Truth(
        joint,
        Ts,
        middle(p, joint),
        poles,
        np.log(poles) / Ts,
        gain,
        closed,
        np.log(closed) / Ts,
        force_per_volt / damping,
        -damping / inertia,
        end_angles(p, joint),
        p[f"{joint}.backlash"],
        breakaway(joint, p),
        {name: p[f"{joint}.{name}"] for name in ("coulomb", "viscous", "bearing_coulomb", "bearing_viscous")},
    )


def _linear_bench(joint: str, p: Parameters) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The bench without its nonlinear parts, at rest at mid stroke."""
    model = bench(joint, p.replace({f"{joint}.coulomb": 0.0, f"{joint}.bearing_coulomb": 0.0}), LINEAR)
    data = mujoco.MjData(model)
    data.qpos[0] = middle(p, joint)
    mujoco.mj_forward(model, data)
    return model, data


def channel(model: mujoco.MjModel, data: mujoco.MjData, steps: int) -> tuple[np.ndarray, float]:
    """Poles (2,) over `steps` simulation steps and integrator gain [rad/s per V] of voltage to angle.

    From mjd_transitionFD. State (angle, speed), input held over the steps: x+ = A^n x + (I + A + ... + A^(n-1)) B u.
    """
    A, B = np.zeros((2 * model.nv, 2 * model.nv)), np.zeros((2 * model.nv, model.nu))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, A, B, None, None)
    lifted_A, lifted_B = np.eye(len(A)), np.zeros_like(B)
    for _ in range(steps):
        lifted_A, lifted_B = A @ lifted_A, A @ lifted_B + B
    poles = np.sort_complex(np.linalg.eigvals(lifted_A).astype(complex))[::-1]
    # With the speed settled, A and B leave speed = a22 speed + b2 u over the whole interval.
    gain = lifted_B[1, 0] / (1 - lifted_A[1, 1])
    return poles, float(gain)


def closed_form(joint: str, p: Parameters, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[float, float, float]:
    """Damping [N m s/rad], inertia [kg m2] and torque per volt [N m/V] at the joint, from the parameters.

    With r the moment arm: damping r^2 ((K gear)^2 / R + viscous) + bearing, inertia r^2 J gear^2 + link, torque
    r K gear / R. Of the model only the bodies' masses and places are used, for the link's inertia.
    """
    constants = motor(p, joint)
    arm = 1.0 if joint == "shoulder" else linkage(p, joint).arm(middle(p, joint))
    damping = arm**2 * (constants.damping + p[f"{joint}.viscous"]) + p[f"{joint}.bearing_viscous"]
    inertia = arm**2 * constants.reflected_inertia + link_inertia(joint, model, data)
    return damping, inertia, arm * constants.force_per_volt


def link_inertia(joint: str, model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Inertia [kg m2] of all that `joint` moves, about its axis (parallel axes: axis' I axis + mass distance^2)."""
    hinge = model.joint(joint + BENCH_LEG)
    axis, anchor = data.xaxis[hinge.id], data.xanchor[hinge.id]
    total = 0.0
    for body in range(int(hinge.bodyid[0]), model.nbody):  # a bench is one chain, its bodies are in order
        turned = data.ximat[body].reshape(3, 3).T @ axis
        lever = np.cross(axis, data.xipos[body] - anchor)
        total += float(turned @ (model.body_inertia[body] * turned) + model.body_mass[body] * lever @ lever)
    return total


def breakaway(joint: str, p: Parameters) -> tuple[float, float]:
    """Voltages [V] that just start `joint` from mid stroke, down and up: (-+ dry friction - load) / torque per volt."""
    model, data = _linear_bench(joint, p)
    _, _, torque_per_volt = closed_form(joint, p, model, data)
    hinge = model.joint(joint + BENCH_LEG)
    axis, anchor = data.xaxis[hinge.id], data.xanchor[hinge.id]
    weight = np.array([0.0, 0.0, -p["gravity"]])
    load = sum(
        float(axis @ np.cross(data.xipos[body] - anchor, model.body_mass[body] * weight))
        for body in range(int(hinge.bodyid[0]), model.nbody)
    )
    arm = 1.0 if joint == "shoulder" else linkage(p, joint).arm(middle(p, joint))
    dry = arm * p[f"{joint}.coulomb"] + p[f"{joint}.bearing_coulomb"]
    return float((-dry - load) / torque_per_volt), float((dry - load) / torque_per_volt)
