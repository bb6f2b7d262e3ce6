"""The twin's physical parameters: one row each, with the source of the number and its place in the model."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from twin.imperfections import GUESS, Row, board_row
from twin.imperfections import TABLE as IMPERFECTIONS

JOINTS = ("shoulder", "thigh", "shank")
LEG = "leg"  # in place of a joint: all three of them at once
REALISATIONS = ("tendon", "closed_loop")
PAPER = "Guni and Irawan 2016, section III"
# The paper names no actuator, link length or friction. What stands here as a GUESS is of the size of catalogue parts,
# and such that a 12 V sweep crosses the stroke in about three quarters of its half period, as the paper's records look.


# Rows that every joint has, in the same units. False: the model that MuJoCo compiles does not depend on it.
_FRICTION = (
    (
        "asymmetry",
        -0.9,
        0.9,
        "1",
        "friction row: Coulomb friction is its mean times (1 + this) up and (1 - this) down",
        False,
    ),
    ("stribeck", 0, 2, "1", "friction row: at rest it is (1 + this) times Coulomb friction", False),
    (
        "load_friction",
        0,
        3,
        "1",
        "friction row: dry friction per axial load; the screw is self-locking from 1 on",
        False,
    ),
)
_SERVO = (
    ("servo_kp", 0, 2000, "V/V", "servo mode: proportional gain, motor voltage per potentiometer voltage error", False),
    ("servo_ki", 0, 2000, "V/(V s)", "servo mode: integral gain of the same error", False),
    ("servo_kd", 0, 100, "V s/V", "servo mode: derivative gain, acts against the rate of the reading", False),
)


def _rod_joint(joint: str, **nominal: float) -> list[Row]:
    """Rows of a joint with a linear actuator; forces and speeds at the rod, angles in the leg's plane."""
    rows = (
        ("rated_voltage", 3, 48, "V", "dcmotor nominal: voltage of the next two numbers"),
        ("no_load_speed", 0.002, 0.1, "m/s", "dcmotor nominal: rod speed at rated voltage without any friction"),
        ("stall_force", 20, 5000, "N", "dcmotor nominal: rod force at rated voltage and standstill"),
        ("lead", 0.0005, 0.02, "m", "dcmotor gear 2 pi gear_ratio / lead"),
        ("gear_ratio", 1, 200, "1", "dcmotor gear 2 pi gear_ratio / lead"),
        ("rotor_inertia", 1e-9, 1e-4, "kg m²", "dcmotor armature"),
        ("retracted_length", 0.05, 0.5, "m", "tendon range: pin to pin when retracted"),
        ("stroke", 0.01, 0.4, "m", "tendon range: extended minus retracted length"),
        ("base_radius", 0.02, 0.4, "m", "site: joint axis to the pin of the actuator's body"),
        ("base_angle", -np.pi, np.pi, "rad", "site: angle of that pin from the leg's outward direction, up positive"),
        ("rod_radius", 0.02, 0.4, "m", "site: joint axis to the pin of the rod"),
        ("rod_angle", -np.pi, np.pi, "rad", "site: angle of that pin at joint angle 0, up positive"),
        ("coulomb", 0, 500, "N", "friction row: dry friction of screw and gear without load, at the rod"),
        *_FRICTION,
        ("stribeck_speed", 1e-5, 0.05, "m/s", "friction row: rod speed over which static friction fades", False),
        ("viscous", 0, 20000, "N s/m", "tendon damping: viscous friction of screw and gear, at the rod"),
        ("bearing_coulomb", 0, 5, "N m", "angle tendon frictionloss: dry friction of the joint's bearing"),
        ("bearing_viscous", 0, 5, "N m s/rad", "angle tendon damping: viscous friction of the joint's bearing"),
        ("backlash", 0.0005, 0.1, "rad", "play hinge range: whole width, between actuator and link"),
        ("switch_margin", 0, 0.005, "m", "limit switches: trip this far before the end of the stroke", False),
        *_SERVO,
    )
    return [_row(joint, nominal, *row) for row in rows]


def _geared_joint(joint: str, **nominal: float) -> list[Row]:
    """Rows of a joint with a geared motor; torques and speeds at the joint."""
    rows = (
        ("rated_voltage", 3, 48, "V", "dcmotor nominal: voltage of the next two numbers"),
        ("no_load_speed", 0.05, 20, "rad/s", "dcmotor nominal: joint speed at rated voltage without any friction"),
        ("stall_torque", 0.2, 200, "N m", "dcmotor nominal: joint torque at rated voltage and standstill"),
        ("gear_ratio", 1, 5000, "1", "dcmotor gear"),
        ("rotor_inertia", 1e-9, 1e-4, "kg m²", "dcmotor armature"),
        ("lower", -np.pi, -0.05, "rad", "joint range: hard stop"),
        ("upper", 0.05, np.pi, "rad", "joint range: hard stop"),
        ("coulomb", 0, 20, "N m", "friction row: dry friction of the gear without load, at the joint"),
        *_FRICTION,
        ("stribeck_speed", 1e-3, 5, "rad/s", "friction row: joint speed over which static friction fades", False),
        ("viscous", 0, 20, "N m s/rad", "joint damping: viscous friction of the gear, at the joint"),
        ("bearing_coulomb", 0, 5, "N m", "angle tendon frictionloss: dry friction of the joint's bearing"),
        ("bearing_viscous", 0, 5, "N m s/rad", "angle tendon damping: viscous friction of the joint's bearing"),
        ("backlash", 0.0005, 0.1, "rad", "play hinge range: whole width, between gear and link"),
        ("switch_margin", 0, 0.1, "rad", "limit switches: trip this far before the hard stop", False),
        *_SERVO,
    )
    return [_row(joint, nominal, *row) for row in rows]


def _row(
    joint: str,
    nominal: Mapping[str, float],
    name: str,
    lower: float,
    upper: float,
    unit: str,
    enters: str,
    compiled: bool = True,
) -> Row:
    """A row of `joint`; its nominal value is an assumption."""
    return Row(f"{joint}.{name}", nominal[name], float(lower), float(upper), unit, GUESS, enters, compiled)


def _rows_of(*names: str) -> list[Row]:
    """The rows that belong to single imperfections."""
    return [row for name in names for row in IMPERFECTIONS[name].rows]


# A row's place decides which of an ensemble's numbers draws it: rows of new imperfections come last.
_ROWS_IN_ORDER = (
    board_row("supply_voltage", 12.0, 3, 48, "V", "drive: motor voltage is limited to plus and minus this"),
    *_rows_of("sag", "pwm", "dead_band"),
    board_row(
        "switch_period",
        0.01,
        0.001,
        0.1,
        "s",
        "drive: interval at which the board reads commands, switches and potentiometers",
    ),
    *_rows_of("delay", "noise"),
    board_row("pot_range", np.deg2rad(270.0), 0.5, 6.3, "rad", "pot: electrical angle of the ADC's full range"),
    *_rows_of("adc"),
    board_row("pot_supply", 5.0, 1, 24, "V", "pot: voltage over pot_range; scale of the reference in servo mode"),
    *_rows_of("nonlinearity", "jitter", "dropouts", "gravity"),
    Row("bench_height", 0.6, 0.2, 1, "m", GUESS, "torso of the bench above the floor; at 0.6 the foot hangs free"),
    Row("torso_mass", 4.0, 0.5, 50, "kg", GUESS, "geom mass; the torso's size in the MJCF is from the paper"),
    Row("shoulder_mass", 0.30, 0.01, 10, "kg", GUESS, "geom mass of the bracket"),
    Row("thigh_mass", 0.35, 0.01, 10, "kg", GUESS, "geom mass of the thigh's tube"),
    Row("shank_mass", 0.25, 0.01, 10, "kg", GUESS, "geom mass of the shank's tube"),
    Row("foot_mass", 0.05, 0.001, 10, "kg", GUESS, "geom mass of the rubber foot"),
    Row("actuator_mass", 0.40, 0.01, 10, "kg", GUESS, "geom mass of a linear actuator, at its base pin"),
    *_geared_joint(
        "shoulder",
        rated_voltage=12.0,
        no_load_speed=1.11,
        stall_torque=6.0,
        gear_ratio=600,
        rotor_inertia=5e-7,
        lower=np.deg2rad(-35.0),
        upper=np.deg2rad(35.0),
        coulomb=0.9,
        asymmetry=0.1,
        stribeck=0.3,
        stribeck_speed=np.deg2rad(2.0),
        load_friction=0.15,
        servo_kp=150,
        servo_ki=0.0,
        servo_kd=0.0,
        viscous=0.15,
        bearing_coulomb=0.1,
        bearing_viscous=0.02,
        backlash=np.deg2rad(1.0),
        switch_margin=np.deg2rad(0.1),
    ),
    *_rod_joint(
        "thigh",
        rated_voltage=12.0,
        no_load_speed=0.0144,
        stall_force=250.0,
        lead=0.002,
        gear_ratio=20,
        rotor_inertia=2.3e-7,
        retracted_length=0.202,
        stroke=0.064,
        base_radius=0.080,
        base_angle=np.deg2rad(90.0),
        rod_radius=0.200,
        rod_angle=0.0,
        coulomb=30.0,
        asymmetry=0.1,
        stribeck=0.3,
        stribeck_speed=0.0005,
        load_friction=1.1,
        servo_kp=500,
        servo_ki=0.0,
        servo_kd=0.0,
        viscous=400.0,
        bearing_coulomb=0.1,
        bearing_viscous=0.02,
        backlash=np.deg2rad(0.5),
        switch_margin=0.0001,
    ),
    *_rod_joint(
        "shank",
        rated_voltage=12.0,
        no_load_speed=0.0144,
        stall_force=220.0,
        lead=0.002,
        gear_ratio=20,
        rotor_inertia=2.3e-7,
        retracted_length=0.154,
        stroke=0.072,
        base_radius=0.190,
        base_angle=np.deg2rad(174.0),
        rod_radius=0.060,
        rod_angle=np.deg2rad(76.5),
        coulomb=25.0,
        asymmetry=0.1,
        stribeck=0.3,
        stribeck_speed=0.0005,
        load_friction=1.1,
        servo_kp=450,
        servo_ki=0.0,
        servo_kd=0.0,
        viscous=400.0,
        bearing_coulomb=0.1,
        bearing_viscous=0.02,
        backlash=np.deg2rad(0.5),
        switch_margin=0.0001,
    ),
)
_ROWS = {row.name: row for row in (*_ROWS_IN_ORDER, *_rows_of(*IMPERFECTIONS))}
ORDERED = len(_ROWS_IN_ORDER)  # rows before those of new imperfections
TABLE: tuple[Row, ...] = tuple(_ROWS.values())


@checked(deferred=("values",))
@dataclass(frozen=True)
class Parameters:
    """Values of the physical parameters in SI, nominal where not given.

    `Parameters({"thigh.coulomb": 40.0})["thigh.stroke"]` is 0.064, with 40 N of dry friction in the thigh's actuator.
    Raises InputError for a name that is not in `TABLE` and for a value that is not a number or outside its bounds.
    """

    values: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in self.values.items():
            if name not in _ROWS:
                raise unknown("parameter", name, _ROWS)
            row = _ROWS[name]
            if isinstance(value, bool) or not isinstance(value, int | float | np.number):
                raise InputError(f"parameter {name} is {value!r}; give a number of {row.unit}")
            if not row.lower <= value <= row.upper:
                raise InputError(
                    f"parameter {name} is {value} {row.unit}; give a value from {row.lower:g} to {row.upper:g}"
                )
        complete = {name: float(self.values.get(name, row.nominal)) for name, row in _ROWS.items()}
        object.__setattr__(self, "values", MappingProxyType(complete))

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    @checked(late=True)
    def switched_off(self, without: Collection[str]) -> Mapping[str, float]:
        """The values of a leg without the imperfections `without`; these are ideal and may be outside bounds."""
        ideal: dict[str, float] = {}
        for name in without:
            if name not in IMPERFECTIONS:
                raise unknown("imperfection", name, IMPERFECTIONS)
            for row, value in IMPERFECTIONS[name].ideal.items():
                ideal |= {row.replace("JOINT", joint): value for joint in JOINTS}
        return {**self.values, **ideal}

    @checked(late=True)
    def replace(self, changes: Mapping[str, float]) -> "Parameters":
        """The same parameters with some values changed."""
        return Parameters({**self.values, **changes})

    def changed(self) -> dict[str, float]:
        """The values that differ from nominal, for a log's header."""
        return {name: value for name, value in self.values.items() if value != _ROWS[name].nominal}

    def __reduce__(self) -> tuple:
        return Parameters, (dict(self.values),)  # a mapping proxy cannot be pickled
