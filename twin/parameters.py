"""The twin's physical parameters: one row each, with the source of the number and its place in the model."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from sysid.base.errors import InputError, unknown

JOINTS = ("shoulder", "thigh", "shank")
LEG = "leg"  # in place of a joint: all three joints at once
# What each switch removes. "friction" removes all friction, dry and viscous, of actuator and bearing; the three after
# it remove a part of the dry friction. "end_stops" removes hard stops and limit switches, "contact" that of foot and
# floor.
IMPERFECTIONS = (
    *("friction", "asymmetry", "stribeck", "load_friction", "end_stops", "backlash"),
    *("pwm", "dead_band", "sag", "delay"),
    *("nonlinearity", "noise", "adc", "jitter", "dropouts"),
    *("gravity", "contact"),
)
REALISATIONS = ("tendon", "closed_loop")
# Rows, of any joint, that the motor board, the potentiometer or the logger reads; the others enter the compiled model.
OUTSIDE_MODEL = frozenset(
    {
        *("supply_voltage", "supply_resistance", "pwm_bits", "dead_band", "switch_period", "delay", "switch_margin"),
        *("pot_noise", "pot_range", "adc_bits", "pot_supply", "pot_linearity", "sample_jitter", "dropout_rate"),
        *("servo_kp", "servo_ki", "servo_kd"),
    }
)


@dataclass(frozen=True)
class Row:
    """A physical parameter. `lower` and `upper` are the limits of the twin and of a calibration."""

    name: str
    nominal: float
    lower: float
    upper: float
    unit: str
    source: str
    enters: str

    @property
    def compiled(self) -> bool:
        """Whether the model that MuJoCo compiles depends on this row."""
        return self.name.rpartition(".")[2] not in OUTSIDE_MODEL


PAPER = "Guni and Irawan 2016, section III"
# The paper gives no actuator, link length or friction. These numbers are of the size of catalogue parts. A 12 V sweep
# crosses the stroke in about three quarters of its half period, as in the paper's records.
GUESS = "assumption"


# Rows that every joint has, in the same units.
_FRICTION = (
    ("asymmetry", -0.9, 0.9, "1", "friction row: Coulomb friction is (1 + this) up and (1 - this) down of its mean"),
    ("stribeck", 0, 2, "1", "friction row: at rest it is (1 + this) times Coulomb friction"),
    ("load_friction", 0, 3, "1", "friction row: dry friction per axial load; the screw is self-locking from 1 on"),
)
_SERVO = (
    ("servo_kp", 0, 2000, "V/V", "servo mode: motor volts per volt of the potentiometer's error"),
    ("servo_ki", 0, 2000, "V/(V s)", "servo mode: motor volts per volt second of the error's integral"),
    ("servo_kd", 0, 100, "V s/V", "servo mode: braking motor volts per volt per second of the reading's rate"),
)


def _rod_joint(joint: str, **nominal: float) -> list[Row]:
    """Rows of a joint that a linear actuator moves; forces and speeds at the rod, angles in the leg's plane."""
    rows = (
        ("rated_voltage", 3, 48, "V", "dcmotor nominal: voltage of the next two numbers"),
        ("no_load_speed", 0.002, 0.1, "m/s", "dcmotor nominal: rod speed at rated voltage without any friction"),
        ("stall_force", 20, 5000, "N", "dcmotor nominal: rod force at rated voltage and standstill"),
        ("lead", 0.0005, 0.02, "m", "dcmotor gear 2 pi gear_ratio / lead"),
        ("gear_ratio", 1, 200, "1", "dcmotor gear 2 pi gear_ratio / lead"),
        ("rotor_inertia", 1e-9, 1e-4, "kg m2", "dcmotor armature"),
        ("retracted_length", 0.05, 0.5, "m", "tendon range: pin to pin when retracted"),
        ("stroke", 0.01, 0.4, "m", "tendon range: extended minus retracted length"),
        ("base_radius", 0.02, 0.4, "m", "site: joint axis to the pin of the actuator's body"),
        (
            "base_angle",
            -np.pi,
            np.pi,
            "rad",
            "site: direction of that pin from the leg's outward direction, up positive",
        ),
        ("rod_radius", 0.02, 0.4, "m", "site: joint axis to the pin of the rod"),
        ("rod_angle", -np.pi, np.pi, "rad", "site: direction of that pin at joint angle 0, up positive"),
        ("coulomb", 0, 500, "N", "friction row: dry friction of screw and gear without load, at the rod"),
        *_FRICTION,
        ("stribeck_speed", 1e-5, 0.05, "m/s", "friction row: rod speed over which static friction fades"),
        ("viscous", 0, 20000, "N s/m", "tendon damping: viscous friction of screw and gear, at the rod"),
        ("bearing_coulomb", 0, 5, "N m", "angle tendon frictionloss: dry friction of the joint's bearing"),
        ("bearing_viscous", 0, 5, "N m s/rad", "angle tendon damping: viscous friction of the joint's bearing"),
        ("backlash", 0.0005, 0.1, "rad", "play hinge range: whole width, between actuator and link"),
        ("switch_margin", 0, 0.005, "m", "limit switches: trip this far before the end of the stroke"),
        *_SERVO,
    )
    return [_row(joint, nominal, *row) for row in rows]


def _geared_joint(joint: str, **nominal: float) -> list[Row]:
    """Rows of a joint that a geared motor turns directly. Torques and speeds at the joint."""
    rows = (
        ("rated_voltage", 3, 48, "V", "dcmotor nominal: voltage of the next two numbers"),
        ("no_load_speed", 0.05, 20, "rad/s", "dcmotor nominal: joint speed at rated voltage without any friction"),
        ("stall_torque", 0.2, 200, "N m", "dcmotor nominal: joint torque at rated voltage and standstill"),
        ("gear_ratio", 1, 5000, "1", "dcmotor gear"),
        ("rotor_inertia", 1e-9, 1e-4, "kg m2", "dcmotor armature"),
        ("lower", -np.pi, -0.05, "rad", "joint range: hard stop"),
        ("upper", 0.05, np.pi, "rad", "joint range: hard stop"),
        ("coulomb", 0, 20, "N m", "friction row: dry friction of the gear without load, at the joint"),
        *_FRICTION,
        ("stribeck_speed", 1e-3, 5, "rad/s", "friction row: joint speed over which static friction fades"),
        ("viscous", 0, 20, "N m s/rad", "joint damping: viscous friction of the gear, at the joint"),
        ("bearing_coulomb", 0, 5, "N m", "angle tendon frictionloss: dry friction of the joint's bearing"),
        ("bearing_viscous", 0, 5, "N m s/rad", "angle tendon damping: viscous friction of the joint's bearing"),
        ("backlash", 0.0005, 0.1, "rad", "play hinge range: whole width, between gear and link"),
        ("switch_margin", 0, 0.1, "rad", "limit switches: trip this far before the hard stop"),
        *_SERVO,
    )
    return [_row(joint, nominal, *row) for row in rows]


def _row(
    joint: str, nominal: Mapping[str, float], name: str, lower: float, upper: float, unit: str, enters: str
) -> Row:
    return Row(f"{joint}.{name}", nominal[name], float(lower), float(upper), unit, GUESS, enters)


TABLE: tuple[Row, ...] = (
    Row("supply_voltage", 12.0, 3, 48, "V", GUESS, "drive: limit of the motor voltage, both signs"),
    Row(
        "supply_resistance", 1.0, 0, 10, "Ohm", GUESS, "drive: supply and wires, shared by all joints; the supply sags"
    ),
    Row("pwm_bits", 8, 4, 16, "1", GUESS, "drive: duty in steps of 1 / (2^bits - 1)"),
    Row("dead_band", 0.3, 0, 3, "V", GUESS, "drive: voltage loss from the bridge's dead time"),
    Row(
        "switch_period",
        0.01,
        0.001,
        0.1,
        "s",
        GUESS,
        "drive: period at which the board reads commands, switches and pots",
    ),
    Row(
        "delay",
        0.02,
        0,
        1,
        "s",
        GUESS,
        "drive: from a command's time stamp to the board, which reads once per switch_period",
    ),
    Row("pot_noise", np.deg2rad(0.2), 0, 0.1, "rad", GUESS, "pot: standard deviation of white noise on a reading"),
    Row("pot_range", np.deg2rad(270.0), 0.5, 6.3, "rad", GUESS, "pot: electrical angle that the ADC's codes divide"),
    Row(
        "adc_bits",
        10,
        4,
        24,
        "1",
        "assumption: the 10-bit converter usual on such an MCU board",
        "pot: 2^bits codes over pot_range",
    ),
    Row("pot_supply", 5.0, 1, 24, "V", GUESS, "pot: volts over pot_range; scale of servo mode's reference"),
    Row("pot_linearity", 0.001, 0, 0.01, "1", GUESS, "pot: largest deviation from a straight line, part of pot_range"),
    Row("sample_jitter", 0.001, 0, 0.05, "s", GUESS, "pot: standard deviation of a sample's time"),
    Row(
        "dropout_rate",
        0.002,
        0,
        0.2,
        "1",
        GUESS,
        "pot: share of the samples that are lost; the log repeats the last one",
    ),
    Row("gravity", 9.81, 0, 20, "m/s2", "standard", "option gravity"),
    Row(
        "bench_height",
        0.6,
        0.2,
        1,
        "m",
        GUESS,
        "height of the bench's torso above the floor; at 0.6 the foot hangs free",
    ),
    Row("torso_mass", 4.0, 0.5, 50, "kg", GUESS, "geom mass; the torso's size is the paper's, in the MJCF"),
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
_ROWS = {row.name: row for row in TABLE}


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
        merged = {name: float(self.values.get(name, row.nominal)) for name, row in _ROWS.items()}
        object.__setattr__(self, "values", MappingProxyType(merged))

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def replace(self, changes: Mapping[str, float]) -> "Parameters":
        """The same parameters with some values changed."""
        return Parameters({**self.values, **changes})

    def changed(self) -> dict[str, float]:
        """The values that differ from nominal, for a log's header."""
        return {name: value for name, value in self.values.items() if value != _ROWS[name].nominal}

    def __reduce__(self) -> tuple:
        return Parameters, (dict(self.values),)  # a mapping proxy cannot be pickled
