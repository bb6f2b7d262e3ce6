"""The physical effects that a comparison names, and the knobs that move them: parameters, ends, how a log is read."""

from collections.abc import Mapping
from dataclasses import dataclass

from sysid.base.errors import InputError
from twin import parameters
from twin.hardware.linkage import end_angles, linkage
from twin.parameters import Parameters

START, DELAY, SLOPE, ZERO = "start", "delay", "slope", "zero"
END_LOW, END_HIGH = "end_low", "end_high"
READ = (DELAY, SLOPE, ZERO)  # these need no simulation of their own: they change how a course is read
_LONGEST = 1.0  # [s]
_SCALES = ("load_friction", "rotor_inertia", "stribeck_speed")
_ROWS = {row.name: row for row in parameters.TABLE}


@dataclass(frozen=True)
class Knob:
    """A value that moves: its nominal value, its bounds, a `typical` change, and changes that a search tries first.

    A knob is a row of the twin's parameters; or "end_low", "end_high" [rad], the angles of the two ends of travel; or
    "delay" [s], "slope" [1], "zero" [rad] of the reading; or "start" [rad], the angle of the drive at the first sample.
    """

    name: str
    unit: str
    nominal: float
    lower: float
    upper: float
    typical: float
    first: tuple[float, ...] = ()
    words: str = ""  # where its name alone does not say it


def knobs(p: Parameters, joint: str, angle: float, largest: float) -> dict[str, Knob]:
    """Every knob of `joint` by name; `angle` [rad] is read at the first sample, `largest` [V] the largest input."""
    low, high = end_angles(p, joint)
    strong = 0.02 * p[f"{joint}.stall_torque" if joint == "shoulder" else f"{joint}.stall_force"]
    dry = max(p[f"{joint}.coulomb"], strong)
    volts, speed = p[f"{joint}.rated_voltage"], p[f"{joint}.no_load_speed"]
    supply = min(p["supply_voltage"], largest) if largest > 0 else p["supply_voltage"]
    entries = [
        Knob(START, "rad", angle, low, high, 0.01),
        Knob(DELAY, "s", 0.0, -_LONGEST, _LONGEST, 0.01, (0.02, 0.06, 0.15)),
        Knob(SLOPE, "1", 1.0, 0.005, 200.0, 0.01),
        Knob(ZERO, "rad", 0.0, -1e3, 1e3, 0.01),
        # An end may move past the other joint angle's bounds; the linkage says what it can reach.
        Knob(END_LOW, "rad", low, low - 0.3, high - 0.1, 0.02, (-0.03, 0.03, 0.09)),
        Knob(END_HIGH, "rad", high, low + 0.1, high + 0.3, 0.02, (-0.09, -0.03, 0.03)),
        _row(f"{joint}.coulomb", p, 0.15 * dry, tuple(k * dry for k in (-0.4, -0.2, -0.1, 0.1, 0.2, 0.45, 0.9))),
        _row(f"{joint}.asymmetry", p, 0.1, (-0.35, -0.15, 0.15, 0.35)),
        _row(f"{joint}.stribeck", p, 0.2),
        _row(f"{joint}.backlash", p, 0.005, (-0.006, 0.01, 0.03)),
        _row("shank_mass", p, 0.1, (-0.15,)),
        _row("foot_mass", p, 0.1, (0.3, 0.8)),
        _row(f"{joint}.rated_voltage", p, 0.03 * volts, (-0.08 * volts, 0.08 * volts, 0.2 * volts)),
        # A limit above the largest command does nothing: it is moved from the largest command down.
        Knob("supply_voltage", "V", supply, 3.0, max(supply, 3.0), 0.04 * supply, (-0.1 * supply, -0.25 * supply)),
        _row(f"{joint}.no_load_speed", p, 0.03 * speed, (-0.08 * speed, 0.08 * speed)),
        _row("dead_band", p, 0.1),
        *(_row(f"{joint}.{name}", p, 0.3 * p[f"{joint}.{name}"] or 1.0) for name in _SCALES),
        _row("supply_resistance", p, 1.0, (4.0,)),
    ]
    return {knob.name: knob for knob in entries}


def _row(name: str, p: Parameters, typical: float, first: tuple[float, ...] = ()) -> Knob:
    row = _ROWS[name]
    return Knob(name, row.unit, p[name], row.lower, row.upper, typical, first)


def apply_knobs(p: Parameters, joint: str, values: Mapping[str, float]) -> Parameters:
    """The parameters with the knobs `values` that belong to the twin; raises InputError for ends out of reach."""
    changes = {name: value for name, value in values.items() if name in _ROWS and name != DELAY}
    if END_LOW in values or END_HIGH in values:
        low, high = end_angles(p, joint)
        low, high = values.get(END_LOW, low), values.get(END_HIGH, high)
        if joint == "shoulder":
            changes |= {"shoulder.lower": low, "shoulder.upper": high}
        else:
            triangle = linkage(p, joint)
            short, long = sorted((float(triangle.length(low)), float(triangle.length(high))))
            changes |= {f"{joint}.retracted_length": short, f"{joint}.stroke": long - short}
    try:
        return p.replace(changes)
    except InputError as error:
        raise InputError(f"no twin is like this: {error}") from None


@dataclass(frozen=True)
class Effect:
    """An effect: `knobs` that it moves (JOINT stands for the joint), words for a sentence, parameters to calibrate.

    `record` are options of `qpal simulate`, which also plan a run on the rig, for a record that shows this effect and
    little else; `why` says what is in it.
    """

    name: str
    words: str
    knobs: tuple[str, ...]
    free: tuple[str, ...]
    record: str
    why: str

    def knobs_of(self, joint: str) -> tuple[str, ...]:
        """Names of the knobs for this joint."""
        return tuple(name.replace("JOINT", joint) for name in self.knobs)

    def free_of(self, joint: str) -> tuple[str, ...]:
        """Names of the twin's parameters that a calibration frees."""
        ends = (
            ("shoulder.lower", "shoulder.upper") if joint == "shoulder" else ("JOINT.retracted_length", "JOINT.stroke")
        )
        names = ends if self.name == "end_stop" else self.free
        return tuple(name.replace("JOINT", joint) for name in names)


TABLE: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        Effect(
            "friction",
            "dry friction",
            ("JOINT.coulomb", "JOINT.asymmetry", "JOINT.stribeck"),
            ("JOINT.coulomb", "JOINT.asymmetry", "JOINT.stribeck"),
            "--excitation staircase --set amplitude=7,hold=0.1,steps=120,order=stairs",
            "slow stairs that start the joint often from low voltages",
        ),
        Effect(
            "backlash",
            "backlash",
            ("JOINT.backlash",),
            ("JOINT.backlash",),
            "--excitation prbs --set amplitude=8",
            "many reversals in the middle of the stroke",
        ),
        Effect(
            "delay",
            "delay",
            (DELAY,),
            ("delay",),
            "--excitation prbs --ts 0.02",
            "fast switching at a short sampling time",
        ),
        Effect(
            "end_stop",
            "end stops",
            (END_LOW, END_HIGH),
            (),
            "--excitation sweep --set jitter=0.5,shrink=0.4",
            "rests at both end stops and turns before them",
        ),
        Effect(
            "load",
            "load",
            ("shank_mass", "foot_mass"),
            ("foot_mass",),  # at one joint the two act alike: a calibration can tell one of them
            "--excitation staircase --set amplitude=7,hold=0.1,steps=120,order=stairs",
            "slow motion in both directions over the whole stroke",
        ),
        Effect(
            "supply",
            "supply",
            ("JOINT.rated_voltage", "supply_voltage", "supply_resistance"),
            ("JOINT.rated_voltage", "supply_voltage", "supply_resistance"),
            "--excitation aprbs",
            "many levels between zero and the largest voltage",
        ),
        Effect(
            "speed",
            "motor speed",
            ("JOINT.no_load_speed",),
            ("JOINT.no_load_speed",),
            "--excitation aprbs",
            "many levels between zero and the largest voltage, long enough to move at a steady speed",
        ),
        Effect(
            "sensor",
            "sensor slope and zero",
            (SLOPE, ZERO),
            (),
            "--excitation sweep --set jitter=0.5,shrink=0.4",
            "both end stops, and turns before them",
        ),
    )
}
