"""The report of `qpal info`: parameters with their sources, the truth of each joint, and two figures of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.information import Information, Joint, Value
from twin.parameters import TABLE
from twin.report import style
from twin.report.page import Grid, Page, Picture, Section
from twin.report.style import styled
from twin.report.units import Quantity, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = dict(zip(("shoulder", "thigh", "shank"), (style.SECOND, style.INPUT, style.MODEL), strict=True))
# How a field of the truth is called and the unit it comes in; one that is not here is listed under its own name.
TRUTH = {
    "operating_point": ("angle at mid stroke", "rad"),
    "poles": ("poles in z, of the compiled model", ""),
    "closed_form_poles": ("poles in z, closed form", ""),
    "poles_s": ("poles in s, of the compiled model", "1/s"),
    "closed_form_poles_s": ("poles in s, closed form", "1/s"),
    "continuous_pole": ("pole of the lag before any time step", "1/s"),
    "gain": ("speed per volt, of the compiled model", "rad/s/V"),
    "closed_form_gain": ("speed per volt, closed form", "rad/s/V"),
    "end_angles": ("ends of travel of the drive side", "rad"),
    "backlash": ("backlash, whole width", "rad"),
    "breakaway_voltage": ("voltage that just moves it, down and up", "V"),
}
HEADINGS = {"joint", "Ts"}  # fields that the table's heading says
RANGES = {"end_angles"}
UNITS = {row.name: row.unit for row in TABLE}
LONGEST = 6  # entries of a list that a cell shows


def page(result: Information) -> Page:
    """The whole report."""
    asked = ", ".join(joint.name for joint in result.joints)
    tables = [value_grid(name, group, result) for name, group in result.groups().items()]
    return Page(
        title="The twin's parameters and its truth",
        subtitle=f"{asked}; Ts {result.Ts:g} s" + (f"; parameters of {result.source}" if result.source else ""),
        verdict=verdict(result),
        sections=[
            Section("Truth", [_TRUTH], tables=[truth_grid(result)], pictures=pictures(result)),
            Section("Parameters", [_PARAMETERS, *_marked(result)], tables=tables),
        ],
        made_with=result.as_dict()["versions"],
    )


_TRUTH = (
    "What a perfect identification of a joint would find. Poles and gain are those of the voltage-to-angle channel at "
    "mid stroke, with viscous friction and without dry friction, play, ends and gravity; the closed form has them from "
    "motor and load constants alone, without the simulation."
)
_PARAMETERS = (
    "Bounds are what the twin accepts and what a calibration may search. Angles are in degrees here; in a parameter "
    "file, which --write-params writes and --params reads, they are in radians, as everything there is in SI units."
)


def verdict(result: Information) -> list[str]:
    """How far and how fast each joint moves, what was changed, and how much is known."""
    return [*map(_moves, result.joints), *_changes(result), _known(result)]


def terminal_tables(result: Information) -> list[Grid]:
    """The parameters without the column that needs most room, the truth and the versions."""
    grids = [value_grid(name, group, result) for name, group in result.groups().items()]
    short = [grid.only(*(heading for heading in grid.headings if heading != ENTERS)) for grid in grids]
    made_with = list(result.as_dict()["versions"].items())
    return [*short, truth_grid(result), Grid(("made with", "version"), made_with, last_text=True)]


ENTERS = "how it enters"


def value_grid(name: str, values: Sequence[Value], result: Information) -> Grid:
    """The parameters of one joint; where some were changed, what they would be, and the others in grey."""
    changed = bool(result.changed)
    rows = []
    for v in values:
        unit = shown_unit(v.row.unit)
        value, nominal, lower, upper = (
            _given(x * unit.factor) for x in (v.value, v.row.nominal, v.row.lower, v.row.upper)
        )
        was = [nominal if v.changed else ""] if changed else []
        rows.append((v.row.name, v.row.enters, v.row.source, value, *was, lower, upper, unit.unit))
    headings = ("parameter", ENTERS, "source", "value", *(["nominal"] if changed else []), "from", "to", "unit")
    quiet = frozenset(k for k, v in enumerate(values) if changed and not v.changed)
    return Grid(headings, rows, name.capitalize() or "All joints", 3, quiet, last_text=True)


def truth_grid(result: Information) -> Grid:
    """The truth, one row a quantity and one column a joint."""
    columns = [dict([*_truth_rows(joint), *_static_rows(joint)]) for joint in result.joints]
    labels = dict.fromkeys(label for column in columns for label in column)
    rows = [(label, *(column.get(label, "–") for column in columns)) for label in labels]
    return Grid((f"truth at Ts {result.Ts:g} s", *(joint.name for joint in result.joints)), rows)


def shown_unit(unit: str) -> Quantity:
    """How a unit is shown: degrees for radians, also per second or per volt; nothing for a plain number."""
    if unit == "rad" or unit.startswith("rad/"):
        return Quantity("", "deg" + unit.removeprefix("rad"), 180.0 / math.pi)
    return Quantity("", "" if unit == "1" else unit)


def _truth_rows(joint: Joint) -> Iterator[tuple[str, str]]:
    for name, value in joint.truth.as_dict().items():
        if name in HEADINGS:
            continue
        if isinstance(value, Mapping):
            for key, entry in value.items():
                unit = shown_unit(UNITS.get(f"{joint.name}.{key}", ""))
                yield f"{_words(name)}: {_words(key)}", f"{_cell(entry, unit.factor)} {unit.unit}".rstrip()
            continue
        label, unit_name = TRUTH.get(name, (_words(name), UNITS.get(f"{joint.name}.{name}", "")))
        unit = shown_unit(unit_name)
        if "poles" in name or "zeros" in name:
            text = _roots(value)
        else:
            text = " to ".join(_cell(v, unit.factor) for v in value) if name in RANGES else _cell(value, unit.factor)
        yield Quantity(label, unit.unit).label, text


def _static_rows(joint: Joint) -> Iterator[tuple[str, str]]:
    at = f"at {_supply(joint)} V"
    speeds = ", ".join(_given(math.degrees(v), 4) for v in joint.characteristic.top_speed)
    yield f"steady speed {at} down and up, mid stroke [deg/s]", speeds
    yield f"end to end {at}, about, down and up [s]", ", ".join(number(t, 2) for t in joint.characteristic.crossing)


def _given(value: float, digits: int = 5) -> str:
    """A number that somebody chose: as short as it is, of `digits` at most."""
    mantissa, e, exponent = number(value, digits).partition("e")
    return (mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa) + e + exponent


def _words(name: str) -> str:
    return name.replace("_", " ")


def _cell(value: Any, factor: float = 1.0) -> str:
    """A plain value as text: a number in its unit, a list as long as it can be read."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return _given(value * factor, 4)
    if isinstance(value, list | tuple):
        return ", ".join(_cell(v, factor) for v in value) if len(value) <= LONGEST else f"{len(value)} values"
    return "–" if value is None else str(value)


def _roots(pairs: Sequence[Sequence[float]]) -> str:
    """[re, im] pairs; what is nothing but rounding beside the largest is shown as 0."""
    size = max((math.hypot(*pair) for pair in pairs), default=0.0)
    texts = []
    for re, im in pairs:
        real = number(0.0 if abs(re) < 1e-6 * size else re, 5)
        sign = "−" if im < 0 else "+"
        texts.append(real if abs(im) < 1e-6 * size else f"{real} {sign} {number(abs(im), 5)}i")
    return ", ".join(texts)


def _moves(joint: Joint) -> str:
    low, high = (_given(math.degrees(q), 3) for q in joint.truth.end_angles)
    ways = [
        f"{number(seconds, 2)} s {way}" if math.isfinite(seconds) else f"never {way}"
        for way, seconds in zip(("down", "up"), joint.characteristic.crossing, strict=True)
    ]
    return (
        f"The {joint.name} travels from {low} to {high} degrees; end to end at {_supply(joint)} V takes about "
        f"{' and '.join(ways)}."
    )


def _supply(joint: Joint) -> str:
    return _given(float(joint.characteristic.voltage[-1]), 3)


def _changes(result: Information) -> list[str]:
    if not result.source:
        return []
    if not result.changed:
        return [f"{result.source} changes none of these parameters."]
    parts = []
    for v in result.changed[:LONGEST]:
        unit = shown_unit(v.row.unit)
        value, nominal = _given(v.value * unit.factor), _given(v.row.nominal * unit.factor)
        parts.append(f"{v.row.name} {value} {unit.unit}".rstrip() + f" instead of {nominal}")
    more = len(result.changed) - len(parts)
    parts += [f"{more} more"] if more else []
    return [f"Not nominal: {', '.join(parts)}."]


def _known(result: Information) -> str:
    return (
        f"Of {len(result.values)} parameters {result.assumed} are assumptions: no datasheet and no measurement stands "
        "behind them."
    )


def _marked(result: Information) -> list[str]:
    return ["Rows in grey are nominal; the others show beside their value what it would be."] if result.changed else []


def pictures(result: Information) -> list[Picture]:
    """Speed over voltage of every joint, and the geometry of those with a linear actuator."""
    found = [
        Picture(
            "speed-over-voltage",
            style.png(speed_over_voltage(result.joints)),
            "Steady speed over voltage at mid stroke, up to the supply's voltage. Between the dots, the break-away "
            "voltages, the joint rests; a load from gravity shifts both to one side. Dry friction is taken at its level "
            "of rest throughout; where it falls with speed, the joint runs a little faster than drawn.",
        )
    ]
    if any(joint.geometry for joint in result.joints):
        found.append(
            Picture(
                "geometry",
                style.png(actuator_geometry(result.joints)),
                "From end to end of the actuator: joint angle over its length, and the moment arm by which its force "
                "acts. Speed per volt goes about as one over the arm: it changes along the travel. Dots: mid stroke.",
            )
        )
    return found


@styled
def speed_over_voltage(joints: Sequence[Joint]) -> Figure:
    """Static characteristic of each joint, one panel each."""
    figure, axes = style.sheet(1, len(joints), height=2.8)
    for ax, joint in zip(axes[0], joints, strict=True):
        curve, down_up = joint.characteristic, np.array(joint.truth.breakaway_voltage)
        ax.axhline(0, color="#cbd2d9", linewidth=0.8)
        ax.axvline(0, color="#cbd2d9", linewidth=0.8)
        ax.plot(curve.voltage, np.degrees(curve.speed), color=COLOURS[joint.name])
        inside = down_up[np.abs(down_up) <= curve.voltage[-1]]
        ax.plot(inside, np.zeros(len(inside)), "o", color=style.INK, markersize=4)
        for volts, align, shift in zip(down_up, ("right", "left"), (-4, 4), strict=True):
            if volts in inside:
                ax.annotate(
                    f"{number(float(volts), 2)} V",
                    (volts, 0),
                    (shift, -11 if shift > 0 else 5),
                    textcoords="offset points",
                    ha=align,
                    fontsize=8,
                )
        ax.set(title=joint.name, xlabel="voltage [V]")
    axes[0, 0].set(ylabel="speed [deg/s]")
    return figure


@styled
def actuator_geometry(joints: Sequence[Joint]) -> Figure:
    """Joint angle over actuator length, and moment arm over joint angle."""
    figure, axes = style.sheet(1, 2, height=3.0)
    left, right = axes[0]
    for joint in joints:
        if joint.geometry is None:
            continue
        g, colour = joint.geometry, COLOURS[joint.name]
        angle, length, arm = np.degrees(g.angle), 1e3 * g.length, 1e3 * g.arm
        left.plot(length, angle, color=colour, label=joint.name)
        right.plot(angle, arm, color=colour)
        middle = np.degrees(joint.truth.operating_point)
        left.plot(np.interp(middle, angle, length), middle, "o", color=colour, markersize=4)
        right.plot(middle, np.interp(middle, angle, arm), "o", color=colour, markersize=4)
    left.set(title="(a) angle over length", xlabel="actuator, pin to pin [mm]", ylabel="joint angle [deg]")
    right.set(title="(b) moment arm over angle", xlabel="joint angle [deg]", ylabel="moment arm [mm]")
    right.set_ylim(bottom=0)
    style.legend(left)
    return figure
