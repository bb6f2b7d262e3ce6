"""The report of `qpal info`: parameters with their sources, the truth of each joint, and two figures of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base import style
from sysid.base.quantities import Quantity, display_quantity, number
from sysid.base.style import styled
from sysid.report.page import Grid, Page, Picture, Section
from twin.parameters import TABLE
from twin.report.info_answer import answer
from twin.studies.information import Information, Joint, Value

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = dict(zip(("shoulder", "thigh", "shank"), (style.SECOND, style.INPUT, style.MODEL), strict=True))
# Label and unit of each field of the truth, or the joint's parameter with the same unit. A field that is
# not listed here is shown under its own name.
TRUTH = {
    "operating_point": ("angle at mid stroke", "rad"),
    "poles": ("poles in z, of the compiled model", ""),
    "closed_form_poles": ("poles in z, closed form", ""),
    "poles_s": ("poles in s, of the compiled model", "1/s"),
    "closed_form_poles_s": ("poles in s, closed form", "1/s"),
    "continuous_pole": ("pole of the lag before any time step", "1/s"),
    "gain": ("speed per volt, of the compiled model", "rad/s/V"),
    "closed_form_gain": ("speed per volt, closed form", "rad/s/V"),
    "end_angles": ("where the drive side rests at its end stops, after full voltage", "rad"),
    "switch_angles": ("where the limit switches trip", "rad"),
    "backlash": ("backlash, whole width", "rad"),
    "load": ("holding force of the drive against weight at mid stroke", "coulomb"),
    "dead_band": ("dead band of the drive", "V"),
    "delay": ("delay of the drive", "s"),
    "breakaway_voltage": ("break-away voltage, down and up", "V"),
    "moving_voltage": ("voltage for friction and load, moving down and up", "V"),
}
HEADINGS = {"joint", "Ts", "mode"}  # fields shown in the table's heading
RANGES = {"end_angles", "switch_angles"}
UNITS = {row.name: row.unit for row in TABLE}
LONGEST = 6  # entries of a list shown in a cell


def page(result: Information, sections: Sequence[Section] = ()) -> Page:
    """The whole report, with `sections` sections before the parameters."""
    names = ", ".join(joint.name for joint in result.joints)
    grids = [value_grid(name, group, result) for name, group in result.groups().items()]
    first, *others = pictures(result)
    said = sentences(result)
    note = ["Rows in grey are nominal; the other rows also show the nominal value."] if result.changed else []
    return Page(
        title="The twin's parameters and its truth",
        subtitle=f"{names}; Ts {result.Ts:g} s" + (f"; parameters of {result.source}" if result.source else ""),
        verdict=said,
        sections=[
            Section("Truth", [_TRUTH], tables=[truth_grid(result)], pictures=others),
            *sections,
            Section("Parameters", [_PARAMETERS, *note], tables=grids),
        ],
        made_with=result.as_dict()["versions"],
        answer=answer(result, first, said[0]),
    )


_TRUTH = (
    "What a perfect identification of a joint would find. Poles and gain are those of the voltage-to-angle channel "
    "at mid stroke, with viscous friction and without dry friction, backlash, ends and gravity. The closed form "
    "needs only motor and load constants and no simulation. Down and up are towards smaller and larger angles."
)
_PARAMETERS = (
    "Bounds are the limits of the twin and of a calibration. Angles are in degrees here. In a parameter file, which "
    "--write-params writes and --params reads, all values are in SI units, so angles are in radians."
)


def sentences(result: Information) -> list[str]:
    """Range and speed of each joint, changed parameters, and the number of assumptions."""
    moves = [_moves(joint, _supply(result)) for joint in result.joints]
    source = (
        f"Of {len(result.values)} parameters {result.assumed} are assumptions without a datasheet or a measurement."
    )
    return [*moves, *_changes(result), source]


def tables(result: Information) -> list[Grid]:
    """The parameters without the widest column, the truth and the versions."""
    grids = [value_grid(name, group, result) for name, group in result.groups().items()]
    short = [grid.only(*(heading for heading in grid.headings if heading != ENTERS)) for grid in grids]
    libraries = list(result.as_dict()["versions"].items())
    return [*short, truth_grid(result), Grid(("made with", "version"), libraries, last_text=True)]


ENTERS = "how it enters"


def value_grid(name: str, values: Sequence[Value], result: Information) -> Grid:
    """The parameters of one joint; if some were changed, with their nominal values and the others in grey."""
    changed = bool(result.changed)
    rows = []
    for v in values:
        unit = display_quantity("", v.row.unit)
        value, nominal = (_shortest(x * unit.factor) for x in (v.value, v.row.nominal))
        lower, upper = (_shortest(x * unit.factor, 3) for x in (v.row.lower, v.row.upper))
        was = [nominal if v.changed else ""] if changed else []
        rows.append((v.row.name, v.row.enters, v.row.source, value, *was, lower, upper, unit.unit.replace("s2", "s²")))
    headings = ("parameter", ENTERS, "source", "value", *(["nominal"] if changed else []), "from", "to", "unit")
    quiet = frozenset(k for k, v in enumerate(values) if changed and not v.changed)
    return Grid(headings, rows, name.capitalize() or "All joints", 3, quiet, last_text=True)


def truth_grid(result: Information) -> Grid:
    """The truth, one row per quantity and one column per joint."""
    columns = [dict([*_truth_rows(joint), *_static_rows(joint, _supply(result))]) for joint in result.joints]
    labels = dict.fromkeys(label for column in columns for label in column)
    rows = [(label, *(column.get(label, "–") for column in columns)) for label in labels]
    return Grid((f"truth at Ts {result.Ts:g} s", *(joint.name for joint in result.joints)), rows)


def _truth_rows(joint: Joint) -> Iterator[tuple[str, str]]:
    """Label and text of every quantity of the truth."""
    for name, value in joint.truth.as_dict().items():
        if name in HEADINGS:
            continue
        if isinstance(value, Mapping):
            for key, entry in value.items():
                yield f"{_words(name)}: {_words(key)}", _with_unit(entry, _unit(joint, key))
            continue
        label, unit_name = TRUTH.get(name, (_words(name), name))
        if (of_joint := _unit(joint, unit_name)) is not None:  # the unit is in the cell if it differs between joints
            yield label, _with_unit(value, of_joint)
            continue
        unit = display_quantity("", unit_name if name in TRUTH else "")
        if "poles" in name or "zeros" in name:
            text = _roots(value)
        else:
            text = " to ".join(_cell(v, unit.factor) for v in value) if name in RANGES else _cell(value, unit.factor)
        yield Quantity(label, unit.unit).label, text


def _unit(joint: Joint, name: str) -> str | None:
    """Unit of the joint's parameter of that name, with or without a direction suffix; None if there is none."""
    return UNITS.get(f"{joint.name}.{name}", UNITS.get(f"{joint.name}.{name.rpartition('_')[0]}"))


def _with_unit(value: Any, unit_name: str | None) -> str:
    unit = display_quantity("", unit_name or "")
    return f"{_cell(value, unit.factor)} {unit.unit}".rstrip()


def _static_rows(joint: Joint, supply: str) -> Iterator[tuple[str, str]]:
    ways = (joint.down, joint.up)
    least = (number(float(way.voltage[0]), 3) if way.starts else "–" for way in ways)
    yield "smallest voltage of a steady motion, however slow, down and up [V]", ", ".join(least)
    speeds = (_shortest(math.degrees(way.top_speed), 4) for way in ways)
    yield f"steady speed at {supply} V, down and up, mid stroke [deg/s]", ", ".join(speeds)
    yield f"end to end at {supply} V, down and up, about [s]", ", ".join(number(way.crossing, 2) for way in ways)


def _shortest(value: float, digits: int = 5) -> str:
    """A chosen number in its shortest form, at most `digits` digits."""
    mantissa, e, exponent = number(value, digits).partition("e")
    return (mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa) + e + exponent


def _words(name: str) -> str:
    return name.replace("_", " ")


def _cell(value: Any, factor: float = 1.0) -> str:
    """A plain value as text: a number in its unit, a list up to a readable length."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return _shortest(value * factor, 4)
    if isinstance(value, list | tuple):
        return ", ".join(_cell(v, factor) for v in value) if len(value) <= LONGEST else f"{len(value)} values"
    return "–" if value is None else str(value)


def _roots(pairs: Sequence[Sequence[float]]) -> str:
    """[re, im] pairs; values that are only rounding relative to the largest are shown as 0."""
    size = max((math.hypot(*pair) for pair in pairs), default=0.0)
    texts = []
    for re, im in pairs:
        real = number(0.0 if abs(re) < 1e-6 * size else re, 5)
        sign = "−" if im < 0 else "+"
        texts.append(real if abs(im) < 1e-6 * size else f"{real} {sign} {number(abs(im), 5)}i")
    return ", ".join(texts)


def _moves(joint: Joint, supply: str) -> str:
    low, high = (_shortest(math.degrees(q), 3) for q in joint.truth.end_angles)
    ways = {"down": joint.down, "up": joint.up}
    times = " and ".join(f"{number(way.crossing, 2)} s {name}" for name, way in ways.items() if way.starts)
    stands = " or ".join(name for name, way in ways.items() if not way.starts)
    texts = [f"end to end at {supply} V takes about {times}"] if times else []
    texts += [f"at {supply} V it does not start {stands}"] if stands else []
    return "; ".join([f"The {joint.name} travels from {low} to {high} degrees", *texts]) + "."


def _supply(result: Information) -> str:
    return _shortest(result.supply, 3)


def _changes(result: Information) -> list[str]:
    """Which parameters differ from their nominal values, as a sentence or none."""
    if not result.source:
        return []
    if not result.changed:
        return [f"{result.source} changes none of these parameters."]
    parts = []
    for v in result.changed[:LONGEST]:
        unit = display_quantity("", v.row.unit)
        value, nominal = _shortest(v.value * unit.factor), _shortest(v.row.nominal * unit.factor)
        parts.append(f"{v.row.name} {value} {unit.unit}".rstrip() + f" instead of {nominal}")
    rest = len(result.changed) - len(parts)
    parts += [f"{rest} more"] if rest else []
    return [f"Not nominal: {', '.join(parts)}."]


def pictures(result: Information) -> list[Picture]:
    """Speed over voltage of every joint, and the geometry of those with a linear actuator."""
    drawings = [
        Picture(
            "speed-over-voltage",
            style.png(speed_over_voltage(result.joints, result.supply)),
            "Steady speed over voltage at mid stroke, up to the supply's voltage. From rest a joint starts at the "
            "dots. A dotted line shows the speed that it then jumps to if friction falls with speed. The weight "
            "shifts the curves of both directions to one side.",
        )
    ]
    if any(joint.geometry for joint in result.joints):
        drawings.append(
            Picture(
                "geometry",
                style.png(actuator_geometry(result.joints)),
                "Joint angle and moment arm of the actuator force over the travel. Speed per volt is about "
                "proportional to the inverse of the arm, so it changes along the travel. Dots: mid stroke.",
            )
        )
    return drawings


@styled
def speed_over_voltage(joints: Sequence[Joint], supply: float) -> Figure:
    """Static characteristic of each joint, one panel each."""
    figure, axes = style.sheet(1, len(joints), height=2.8)
    for ax, joint in zip(axes[0], joints, strict=True):
        colour = COLOURS[joint.name]
        ax.axhline(0, color="#cbd2d9", linewidth=0.8)
        ax.axvline(0, color="#cbd2d9", linewidth=0.8)
        rest = np.clip([joint.down.breakaway, joint.up.breakaway], -supply, supply)
        ax.plot(rest, [0, 0], color=colour)
        for way, align, shift in ((joint.down, "right", (-4, 5)), (joint.up, "left", (4, -11))):
            if not way.starts:
                continue
            ax.plot(way.voltage, np.degrees(way.speed), color=colour)
            ax.plot([way.breakaway] * 2, [0, math.degrees(way.jump)], ":", color=colour)
            ax.plot(way.breakaway, 0, "o", color=style.INK, markersize=4)
            text = f"{number(way.breakaway, 2)} V"
            ax.annotate(text, (way.breakaway, 0), shift, textcoords="offset points", ha=align, fontsize=8)
        ax.set(title=joint.name, xlabel="voltage [V]")
    axes[0, 0].set(ylabel="speed [deg/s]")
    return figure


@styled
def actuator_geometry(joints: Sequence[Joint]) -> Figure:
    """Joint angle over actuator length, and moment arm over joint angle."""
    figure, axes = style.sheet(1, 2, height=3.0)
    angle_axes, arm_axes = axes[0]
    for joint in joints:
        if joint.geometry is None:
            continue
        g, colour = joint.geometry, COLOURS[joint.name]
        angle, length, arm = np.degrees(g.angle), 1e3 * g.length, 1e3 * g.arm
        angle_axes.plot(length, angle, color=colour, label=joint.name)
        arm_axes.plot(angle, arm, color=colour)
        middle = np.degrees(joint.truth.operating_point)
        angle_axes.plot(np.interp(middle, angle, length), middle, "o", color=colour, markersize=4)
        arm_axes.plot(middle, np.interp(middle, angle, arm), "o", color=colour, markersize=4)
    angle_axes.set(title="(a) angle over length", xlabel="actuator, pin to pin [mm]", ylabel="joint angle [deg]")
    arm_axes.set(title="(b) moment arm over angle", xlabel="joint angle [deg]", ylabel="moment arm [mm]")
    arm_axes.set_ylim(bottom=0)
    style.legend(angle_axes)
    return figure
