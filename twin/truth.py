"""Ground truth of one joint: the values that an identifier should find in the twin's logs."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from sysid.base.checks import checked, short_text
from sysid.base.errors import InputError, unknown
from sysid.base.files import json_value
from twin.hardware.actuator import MODES, drive, dry_friction, motor
from twin.hardware.linkage import linkage, middle, stroke
from twin.hardware.potentiometer import potentiometer
from twin.imperfections import IMPERFECTIONS
from twin.parameters import Parameters
from twin.plant import slots
from twin.plant.board import circuit, user_data
from twin.plant.leg import BENCH_LEG, bench, check_joint
from twin.plant.stepping import Run, attempt

LONGEST = 1000.0  # [s] of a sampling time: a million steps of the simulation
# Effects that the linearisation omits besides Coulomb friction.
LINEAR = tuple(name for name in IMPERFECTIONS if name != "friction")


@dataclass(frozen=True)
class Truth:
    """Input-to-angle channel of a bench joint at mid stroke, and the levels of its imperfections.

    Mode "voltage": the channel is a first-order lag and an integrator. `poles` (n,) in z at Ts come from the compiled
    model with its time step, `closed_form_poles` (n,) from motor and load constants with the same integration step;
    `poles_s` and `closed_form_poles_s` [1/s] are log(z) / Ts. `continuous_pole` [1/s] is the lag's pole -damping /
    inertia before any time step (the implicit step of h = 1 ms shows a pole s as -log(1 - s h) / h, about 1 % slower).
    gain and closed_form_gain [rad/s per V]: speed per volt in steady state. Mode "servo": the poles are those of the
    position loop, at the board's sampling time; gain and closed_form_gain [rad/V] are its angle per volt of reference.
    The linearisation omits dry friction, backlash, end stops, gravity, delay, nonlinearity and quantisation; it
    includes viscous friction.

    end_angles [rad]: where the drive side rests after it ran into each end at full supply voltage; the link rests up
    to backlash / 2 beyond. switch_angles [rad]: where the limit switches disconnect the motor; a slower drive rests
    between the two. backlash [rad]: whole width.
    load [N or N m]: holding force of the drive at mid stroke from the weight of the links. breakaway_voltage [V]:
    smallest command that starts the joint from rest at mid stroke towards smaller and larger angles, with weight, dry
    friction, dead band and sag (without PWM steps); infinite if the supply is too low. moving_voltage [V]: the same
    without the friction that only rest has (Stribeck): what an identifier of steady motion finds for friction and
    load. dead_band [V]: that of the drive. delay [s]: until the board reads a command, in whole periods of the board.
    friction: the levels, at rod or joint.
    """

    joint: str
    Ts: float
    mode: str
    operating_point: float
    poles: np.ndarray
    poles_s: np.ndarray
    gain: float
    closed_form_poles: np.ndarray
    closed_form_poles_s: np.ndarray
    closed_form_gain: float
    continuous_pole: float
    end_angles: tuple[float, float]
    switch_angles: tuple[float, float]
    backlash: float
    load: float
    breakaway_voltage: tuple[float, float]
    moving_voltage: tuple[float, float]
    dead_band: float
    delay: float
    friction: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """The same as plain numbers and lists, for JSON; poles as [re, im], infinite values as None."""
        return json_value(asdict(self))


@checked(deferred=("Ts",))
def truth(joint: str, Ts: float = 0.1, parameters: Parameters | None = None, mode: str = "voltage") -> Truth:
    """The truth about `joint` sampled every `Ts` [s]; raises InputError for an invalid joint, Ts or mode."""
    check_joint(joint)
    if mode not in MODES:
        raise unknown("mode", mode, MODES)
    if isinstance(Ts, (int, float)) and LONGEST < Ts < np.inf:
        raise InputError(
            f"Ts is {short_text(Ts)} s; give at most {LONGEST:g} s, since each step of the simulation is made"
        )
    p = parameters or Parameters()
    model, data = linear_bench(joint, p)
    h = model.opt.timestep
    steps = Ts / h if isinstance(Ts, int | float) and 0 < Ts < np.inf else 0.0
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6 * steps:
        raise InputError(f"Ts is {Ts!r} s; give a whole number of milliseconds, the step of the simulation")
    damping, inertia, torque_per_volt = closed_form(joint, p, model, data)
    close = position_loop(p, joint, h) if mode == "servo" else channel
    poles, gain = close(*linearise(model, data), round(steps))
    closed_poles, closed_gain = close(*implicit_step(damping, inertia, torque_per_volt, h), round(steps))
    dry, switches = dry_friction(p, joint), drive(p, joint)
    return Truth(
        joint,
        Ts,
        mode,
        middle(p, joint),
        poles,
        np.log(poles) / Ts,
        gain,
        closed_poles,
        np.log(closed_poles) / Ts,
        closed_gain,
        -damping / inertia,
        rest_angles(p, joint),
        switch_angles(p, joint),
        p[f"{joint}.backlash"],
        load(joint, p, model, data),
        breakaway(joint, p),
        breakaway(joint, p.replace({f"{joint}.stribeck": 0.0})),
        switches.dead_band,
        _effective_delay(p["delay"], switches.period, h),
        {
            "coulomb_up": dry.up,
            "coulomb_down": dry.down,
            **{name: p[f"{joint}.{name}"] for name in ("stribeck", "stribeck_speed", "load_friction")},
            **{name: p[f"{joint}.{name}"] for name in ("viscous", "bearing_coulomb", "bearing_viscous")},
        },
    )


def _effective_delay(delay: float, period: float, h: float) -> float:
    """Effective delay of `delay` [s]: commands arrive in whole simulation steps, the board reads once per period."""
    tick = max(1, round(period / h))
    return -(-round(delay / h) // tick) * tick * h


def linear_bench(joint: str, p: Parameters) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The bench without its nonlinear parts, at rest at mid stroke."""
    model = bench(joint, p.replace({f"{joint}.coulomb": 0.0, f"{joint}.bearing_coulomb": 0.0}), LINEAR)
    data = mujoco.MjData(model)
    data.qpos[0] = middle(p, joint)
    mujoco.mj_forward(model, data)
    return model, data


def linearise(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """A (2, 2) and B (2,) of one simulation step by mjd_transitionFD; state (angle, speed), input the motor voltage."""
    A, B = np.zeros((2 * model.nv, 2 * model.nv)), np.zeros((2 * model.nv, model.nu))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, A, B, None, None)
    return A, B[:, 0]


def implicit_step(damping: float, inertia: float, torque_per_volt: float, h: float) -> tuple[np.ndarray, np.ndarray]:
    """The same from constants: v+ = (v + h torque / inertia u) / (1 + h damping / inertia), q+ = q + h v+."""
    fade = 1.0 / (1.0 + h * damping / inertia)
    push = fade * h * torque_per_volt / inertia
    return np.array([[1.0, h * fade], [0.0, fade]]), np.array([h * push, push])


def channel(A: np.ndarray, B: np.ndarray, steps: int) -> tuple[np.ndarray, float]:
    """Poles (2,) over `steps` simulation steps and integrator gain [rad/s per V] of voltage to angle.

    Input held over the steps: x+ = A^n x + (I + A + ... + A^(n-1)) B u.
    """
    lifted_A, lifted_B = _lift(A, B, steps)
    # In steady state speed = a22 speed + b2 u over the whole interval.
    return _sort_poles(np.linalg.eigvals(lifted_A)), float(lifted_B[1] / (1 - lifted_A[1, 1]))


def position_loop(p: Parameters, joint: str, h: float) -> Callable[[np.ndarray, np.ndarray, int], tuple]:
    """A function like `channel` for servo mode: poles (n,) of the closed loop and its angle per volt of reference.

    The board reads v = s angle [V] every T and holds kp (r - v) + ki I - kd (v - last) / T over it, where I already
    includes T (r - v). Its states are I and the last reading, if ki and kd are used.
    """
    board, s = drive(p, joint), potentiometer(p).scale
    tick = max(1, round(board.period / h))
    T, kp, ki, kd = tick * h, board.kp, board.ki, board.kd

    def close(A: np.ndarray, B: np.ndarray, steps: int) -> tuple[np.ndarray, float]:
        plant, push = _lift(A, B, tick)
        loop = np.zeros((4, 4))
        law = np.array([-s * (kp + ki * T + kd / T), 0.0, ki, kd / T])  # volts from angle, speed, I, last reading
        loop[:2, :2] = plant
        loop[:2] += np.outer(push, law)
        loop[2] = [-T * s, 0.0, 1.0, 0.0]
        loop[3, 0] = s
        states = [0, 1] + [2] * (ki > 0) + [3] * (kd > 0)
        poles = np.linalg.eigvals(loop[np.ix_(states, states)]).astype(complex)
        return _sort_poles(poles ** (steps / tick)), 1.0 / s

    return close


def _lift(A: np.ndarray, B: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """A and B over several steps with the input held."""
    lifted_A, lifted_B = np.eye(len(A)), np.zeros_like(B)
    for _ in range(steps):
        lifted_A, lifted_B = A @ lifted_A, A @ lifted_B + B
    return lifted_A, lifted_B


def _sort_poles(poles: np.ndarray) -> np.ndarray:
    return np.sort_complex(poles.astype(complex))[::-1]


def closed_form(joint: str, p: Parameters, model: mujoco.MjModel, data: mujoco.MjData) -> tuple[float, float, float]:
    """Damping [N m s/rad], inertia [kg m2] and torque per volt [N m/V] at the joint, from the parameters.

    With r the moment arm: damping r^2 ((K gear)^2 / R + viscous) + bearing, inertia r^2 J gear^2 + link, torque
    r K gear / R. The model gives only the masses and positions of the bodies, for the link's inertia.
    """
    constants, r = motor(p, joint), arm(joint, p)
    damping = r**2 * (constants.damping + p[f"{joint}.viscous"]) + p[f"{joint}.bearing_viscous"]
    inertia = r**2 * constants.reflected_inertia + link_inertia(joint, model, data)
    return damping, inertia, r * constants.force_per_volt


def link_inertia(joint: str, model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Inertia [kg m2] of all that `joint` moves, about its axis (parallel axes: axis' I axis + mass distance^2)."""
    hinge = model.joint(joint + BENCH_LEG)
    axis, anchor = data.xaxis[hinge.id], data.xanchor[hinge.id]
    total = 0.0
    for body in range(int(hinge.bodyid[0]), model.nbody):  # a bench is one chain with its bodies in order
        axis_in_body = data.ximat[body].reshape(3, 3).T @ axis
        lever = np.cross(axis, data.xipos[body] - anchor)
        total += float(axis_in_body @ (model.body_inertia[body] * axis_in_body) + model.body_mass[body] * lever @ lever)
    return total


def load(joint: str, p: Parameters, model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Holding force of the drive of `joint` at mid stroke against the weight of the links [N or N m], up positive."""
    hinge = model.joint(joint + BENCH_LEG)
    axis, anchor = data.xaxis[hinge.id], data.xanchor[hinge.id]
    weight = np.array([0.0, 0.0, -p["gravity"]])
    torque = sum(
        float(axis @ np.cross(data.xipos[body] - anchor, model.body_mass[body] * weight))
        for body in range(int(hinge.bodyid[0]), model.nbody)
    )
    return -torque / arm(joint, p)


def arm(joint: str, p: Parameters) -> float:
    """Drive position per joint angle at mid stroke [m/rad], 1 for the shoulder."""
    return 1.0 if joint == "shoulder" else linkage(p, joint).arm(middle(p, joint))


def breakaway(joint: str, p: Parameters) -> tuple[float, float]:
    """Break-away commands [V] of `joint` at mid stroke, down and up.

    The drive must overcome the link's weight and bearing friction, and its own static friction under that load.
    """
    weight = load(joint, p, *linear_bench(joint, p))
    bearing = p[f"{joint}.bearing_coulomb"] / abs(arm(joint, p))
    constants, dry, board = motor(p, joint), dry_friction(p, joint), drive(p, joint)
    volts = []
    for direction in (-1, 1):
        required = weight + direction * bearing
        force = required + direction * dry.static(direction, required)
        try:
            volts.append(board.command(force / constants.force_per_volt, constants.resistance))
        except ValueError:
            volts.append(float(np.copysign(np.inf, force)))
    return volts[0], volts[1]


RUN_UP = 0.15  # of the stroke before the switch, from which the drive starts at rest
FASTEST = 0.2  # [s] least time for the way to the switch
PATIENCE = 5.0  # times of the way at no-load speed until the drive must have arrived
ALONE = ("backlash", "noise", "adc", "nonlinearity", "jitter", "dropouts", "delay", "contact")


def switch_angles(parameters: Parameters, joint: str) -> tuple[float, float]:
    """Joint angles [rad] at which the limit switches disconnect the motor, never outside the stroke's ends."""
    low, high = stroke(parameters, joint)
    board = drive(parameters, joint)
    positions = max(board.lower, low), min(board.upper, high)
    if joint == "shoulder":
        return positions
    triangle = linkage(parameters, joint)
    return triangle.angle(positions[0]), triangle.angle(positions[1])


def rest_angles(parameters: Parameters, joint: str) -> tuple[float, float]:
    """Joint angles [rad] at which the drive rests after it ran into each end at full supply voltage.

    The backlash is centred. Between switch and hard stop this depends on the speed of arrival: a slower drive rests
    closer to the switch. Where full voltage does not bring the drive to a switch, the angle is the switch's.
    """
    return _rest_angles(joint, tuple(parameters.values.items()))


@lru_cache(maxsize=256)
def _rest_angles(joint: str, rows: tuple[tuple[str, float], ...]) -> tuple[float, float]:
    """The cached simulation behind `rest_angles`; `rows` are the parameters, which a cache can hold as a tuple."""
    p = Parameters(dict(rows))
    model, board = bench(joint, p, ALONE), circuit(p, joint, ALONE)
    h, angles = model.opt.timestep, []
    for way, switch in zip((-1.0, 1.0), switch_angles(p, joint), strict=True):
        start = switch - way * RUN_UP * float(np.ptp(switch_angles(p, joint)))
        fastest = max(abs(switch - start) / _top_speed(p, joint, switch), FASTEST)
        N = round(PATIENCE * fastest / h)
        qpos = np.zeros(model.nq)
        qpos[model.joint(joint + BENCH_LEG).qposadr[0]] = start
        volts = np.full((N, 1), way * p["supply_voltage"])
        run = Run(model, user_data(model, [board]), qpos, volts, volts[0] * 0.0, 0.0, np.zeros(N))
        outputs, _ = attempt([run], h, 0.0)  # nan where MuJoCo gave up: then it has not arrived
        last = float(outputs[0, -1, 0, slots.ANGLE])
        angles.append(last if way * (last - switch) > 0.0 else switch)
    return angles[0], angles[1]


def _top_speed(p: Parameters, joint: str, angle: float) -> float:
    """Speed [rad/s] at full supply voltage without any friction."""
    speed = p[f"{joint}.no_load_speed"] * p["supply_voltage"] / p[f"{joint}.rated_voltage"]
    return speed if joint == "shoulder" else speed / abs(linkage(p, joint).arm(angle))
