"""A servo with a pendulum on a stand, and its response to a recorded voltage: the twin of a servo's test bench."""

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, fields, replace

import mujoco
import numpy as np

from sysid.base.checks import array, checked
from sysid.base.errors import InputError, unknown
from twin.hardware.actuator import motor
from twin.imperfections import IMPERFECTIONS
from twin.parameters import Parameters
from twin.plant import slots
from twin.plant.board import add_sensor, circuit, user_data
from twin.plant.leg import BENCH_LEG, LEAST
from twin.plant.stepping import TIMESTEP, Run, attempt

JOINT = "shoulder"  # whose rows describe the servo: motor, gear, friction and gains at the joint
NAME = JOINT + BENCH_LEG
# As in the MJCF of the leg: MuJoCo's default friction lets a loaded joint creep.
STIFF = {"solimp_friction": [0.9999, 0.9999, 0.001, 0.5, 2], "solref_friction": [0.002, 1]}


@checked
def pendulum(parameters: Parameters, mass: float, length: float, without: Collection[str] = ()) -> mujoco.MjModel:
    """A hinge with `mass` [kg] at `length` [m], hanging at angle 0, driven by the motor of `JOINT`.

    It has no backlash and no end stops. Raises InputError for a mass or length that is not positive.
    """
    if not (0.0 < mass < np.inf and 0.0 < length < np.inf):
        raise InputError(f"the pendulum has {mass} kg at {length} m; give a positive mass and length")
    values, constants = parameters.switched_off(without), motor(parameters, JOINT)
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.001
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.tolerance = 1e-12
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND  # the board writes into the solver's friction rows
    spec.option.gravity[2] = -values["gravity"]
    # A point mass has no inertia of its own, which MuJoCo does not take: a ball of a gram's inertia does no harm.
    body = spec.worldbody.add_body(
        name="pendulum", mass=mass, ipos=[0, 0, -length], inertia=[1e-9] * 3, explicitinertial=True
    )
    hinge = body.add_joint(name=NAME, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    hinge.solimp_friction, hinge.solref_friction = STIFF["solimp_friction"], STIFF["solref_friction"]
    hinge.frictionloss = max(values[f"{JOINT}.coulomb"], LEAST)
    hinge.damping[0] = values[f"{JOINT}.viscous"]
    hinge.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    actuator = spec.add_actuator(name=NAME, target=NAME, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_dcmotor(motorconst=[constants.constant] * 2, resistance=constants.resistance)
    actuator.gear[0], actuator.armature = constants.gear, constants.inertia
    add_sensor(spec)
    return spec.compile()


# A stand has what the servo's voltage log shows; the rest of the leg's imperfections is left out.
KEPT = ("friction", "load_friction", "stribeck", "sag", "gravity")
WITHOUT = tuple(name for name in IMPERFECTIONS if name not in KEPT)
NO_SWITCH = 1e9  # [rad]: a servo without end stops turns on
GEAR = 288.4  # of an XL330-M288-T; only the rotor's inertia at the output counts


@checked(late=True)
@dataclass(frozen=True)
class Pendulum:
    """`mass` [kg] at `length` [m] on a servo's horn; angle 0 hangs down.

    The first values are those of a ROBOTIS XL330-M288-T at 5 V (e-manual: 0.52 N m, 103 rev/min, 288.4 : 1); friction,
    inertia and zero are in no data sheet and are assumptions. no_load_speed [rad/s] and stall_torque [N m] are at
    `rated_voltage` [V]; rotor_inertia [kg m2] is at the output. Dry friction is coulomb (1 + stribeck exp(-(v /
    stribeck_speed)^2)) + load_friction |torque on the pendulum| [N m]. `supply_resistance` [Ohm] lowers the voltage
    with the motor's current, measured against a supply of `supply_voltage` [V]; a record's voltage may not exceed it.
    `delay` [s] is continuous; `zero` [rad] is what the sensor reads at the lowest point.
    """

    mass: float
    length: float
    rated_voltage: float = 5.0
    supply_voltage: float = 10.0
    no_load_speed: float = 10.79
    stall_torque: float = 0.52
    rotor_inertia: float = 0.001
    coulomb: float = 0.01
    stribeck: float = 0.0
    stribeck_speed: float = 0.1
    load_friction: float = 0.1
    viscous: float = 0.0
    supply_resistance: float = 0.1
    delay: float = 0.0
    zero: float = 0.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not -np.inf < value < np.inf or (value < 0.0 and name != "zero"):
                raise InputError(f"{name} of the pendulum is {value}; give a number of at least 0")
        self.parameters()  # what the motor cannot be is said here

    def parameters(self) -> Parameters:
        """The servo in the rows of the leg's geared motor."""
        row_names = ("rated_voltage", "no_load_speed", "stall_torque", "coulomb", "stribeck", "stribeck_speed")
        values = {f"{JOINT}.{name}": getattr(self, name) for name in (*row_names, "load_friction", "viscous")}
        return Parameters(
            {
                **values,
                f"{JOINT}.gear_ratio": GEAR,
                f"{JOINT}.rotor_inertia": self.rotor_inertia / GEAR**2,
                "supply_voltage": self.supply_voltage,
                "supply_resistance": self.supply_resistance,
                "switch_period": TIMESTEP,
            }
        )

    @checked(late=True)
    def replace(self, **changes: float) -> "Pendulum":
        """The same pendulum with some values changed; raises InputError for an unknown name."""
        names = [field.name for field in fields(self)]
        for name in changes:
            if name not in names:
                raise unknown("value of a pendulum", name, names)
        return replace(self, **changes)


@checked(late=True)
def respond(
    pendulums: Sequence[Pendulum], u: np.ndarray, Ts: float, starts: Sequence[float] | np.ndarray, threads: int = 2
) -> np.ndarray:
    """Angles (runs, N) [rad] that the sensor reads at k Ts, one row for each pendulum, all in one batch.

    u (N,) [V] is held from sample to sample. The pendulums start at rest where the sensor reads `starts` (runs,) [rad].
    Rows of failed simulations are NaN. Raises InputError for a voltage above the supply.
    """
    u, starts = array("u", u).ravel(), array("starts", starts).ravel()
    if not len(pendulums) or len(starts) != len(pendulums):
        raise InputError(f"{len(starts)} starts are given for {len(pendulums)} pendulums; give one for each")
    largest = min(p.supply_voltage for p in pendulums)
    if np.abs(u).max() > largest:
        raise InputError(
            f"the record reaches {np.abs(u).max():g} V, the pendulum's supply {largest:g} V; raise supply_voltage"
        )
    N, steps = len(u), int(np.ceil(len(u) * Ts / TIMESTEP)) + 1
    indices = np.minimum(np.floor(np.arange(steps) * TIMESTEP / Ts + 1e-9).astype(int), N - 1)
    commands = u[indices][:, None]
    models: dict[Pendulum, tuple] = {}
    runs = []
    for servo, start in zip(pendulums, starts, strict=True):
        key = servo.replace(delay=0.0, zero=0.0)  # neither is in the simulation
        if key not in models:
            models[key] = board(key)
        model, data = models[key]
        position = np.array([start - servo.zero])
        runs.append(
            Run(model, at_rest(data, servo, position[0]), position, commands, np.zeros(1), 0.0, np.zeros(steps))
        )
    outputs, _ = attempt(runs, TIMESTEP, 0.0, threads)
    fine, times = np.arange(steps) * TIMESTEP, np.arange(N) * Ts
    return np.stack(
        [
            servo.zero + np.interp(times - servo.delay, fine, row)
            for servo, row in zip(pendulums, outputs[:, :, 0, slots.READING], strict=True)
        ]
    )


@checked
def board(servo: Pendulum) -> tuple[mujoco.MjModel, np.ndarray]:
    """Model and user data of one pendulum."""
    p = servo.parameters()
    model = pendulum(p, servo.mass, servo.length, WITHOUT)
    state = user_data(model, [circuit(p, JOINT, WITHOUT)])
    state[slots.HEAD + slots.LOWER], state[slots.HEAD + slots.UPPER] = -NO_SWITCH, NO_SWITCH
    return model, state


def at_rest(board: np.ndarray, servo: Pendulum, angle: float) -> np.ndarray:
    """The board with the load that has pressed the gears for long at `angle` [rad]."""
    state = board.copy()
    state[slots.HEAD + slots.LOAD] = servo.mass * servo.parameters()["gravity"] * servo.length * np.sin(angle)
    return state
