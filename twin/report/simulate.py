"""The report of `qpal simulate`: the applied input, the measured output and the truth."""

from typing import TYPE_CHECKING

import numpy as np

from sysid import plots
from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import number
from sysid.base.style import styled
from sysid.report import zoom
from sysid.report.page import Grid, Page, Picture, Section
from twin.parameters import Parameters
from twin.report import leg
from twin.studies.simulation import Part, Simulation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def page(result: Simulation) -> Page:
    """The report on one experiment."""
    log = result.log
    records = [picture for part in result.parts for picture in _pictures(part, log.mode, log.meta["without"])]
    return Page(
        title=f"Experiment on the {log.joint}",
        subtitle=(
            f"{log.meta['excitation']}, {log.mode} mode, {log.N} samples, Ts {log.Ts:g} s, seed {log.meta['seed']}"
        ),
        verdict=[_verdict(part) for part in result.parts],
        sections=[
            Section("Record", pictures=records),
            Section("The leg", pictures=[_leg(result)]),
            Section("Truth", [_TRUTH[log.mode]], tables=tables(result)),
        ],
        made_with=versions(),
    )


_TRUTH = {
    "voltage": "What a perfect identification of this joint would find, at mid stroke.",
    "servo": "What a perfect identification of this position loop would find, at mid stroke.",
}
_INPUT = {"voltage": "Commanded voltage", "servo": "Reference of the position loop"}


def _verdict(part: Part) -> str:
    lo, hi = np.degrees(part.range).tolist()
    return (
        f"The {part.joint} moved between {number(lo, 3)} and {number(hi, 3)} degrees and rested at an end for "
        f"{100 * part.resting:.0f} % of the time."
    )


def _leg(result: Simulation) -> Picture:
    """The leg as the experiment moved it, with the lengths of its own parameters."""
    parameters = Parameters().replace(dict(result.log.meta.get("parameters_changed", {})))
    angles = {part.joint: part.y_true for part in result.parts}
    return leg.picture("leg", result.parts[0].data.t, {"twin": angles}, parameters)


def _pictures(part: Part, mode: str, omitted: list[str]) -> list[Picture]:
    """The record of a joint, and the error of its reading."""
    data, switched_off = part.data, ", ".join(omitted) or "nothing"
    return [
        Picture(
            f"data-{part.joint}",
            style.png(plots.record(data)),
            f"{_INPUT[mode]} and angle that the potentiometer read, {part.joint}; switched off: {switched_off}.",
            zoom.record(data),
        ),
        Picture(
            f"measurement-error-{part.joint}",
            style.png(measurement_error(data.t, data.y[:, 0], part.y_true)),
            f"Error of the {part.joint}'s reading from noise, ADC steps and missed samples. A missed sample repeats "
            "the previous one, so it appears as a spike while the joint moves.",
            zoom.lines(data.t, {"error": data.y[:, 0] - part.y_true}, "error", "rad", "measured less true angle"),
        ),
    ]


@styled
def measurement_error(t: np.ndarray, reading: np.ndarray, true: np.ndarray) -> "Axes":
    """Measured less true angle [rad], shown in degrees."""
    (ax,) = style.panels(None, height=2.2)
    style.line(ax, t, np.degrees(reading - true), color=style.SECOND, linewidth=0.8)
    ax.set(xlabel="time [s]", ylabel="error [deg]", title="measured less true angle")
    return ax


def tables(result: Simulation) -> list[Grid]:
    """The truth of each joint, one row per quantity."""
    return [_table(part) for part in result.parts]


def _table(part: Part) -> Grid:
    """The truth of a joint, a row for each quantity."""
    t = part.truth
    lo, hi = (number(float(np.degrees(angle)), 4) for angle in t.end_angles)
    low_volts, high_volts = (number(volts, 3) for volts in t.breakaway_voltage)
    gain = "degrees per volt of reference" if t.mode == "servo" else "speed per volt [deg/s/V]"
    rows = [
        ("poles in z", ", ".join(_pole(z) for z in t.poles)),
        ("time constant of the lag [s]", number(-1.0 / t.continuous_pole, 3)),
        (gain, number(float(np.degrees(t.gain)), 4)),
        ("ends of travel [deg]", f"{lo} to {hi}"),
        ("backlash, whole width [deg]", number(float(np.degrees(t.backlash)), 3)),
        ("break-away voltage, down / up [V]", f"{low_volts} / {high_volts}"),
        ("dead band of the drive [V]", number(t.dead_band, 3)),
        ("delay of the command [s]", number(t.delay, 3)),
    ]
    return Grid((f"truth of the {t.joint}", "value"), rows)


def _pole(z: complex) -> str:
    return f"{z.real:.5f}" if abs(z.imag) < 1e-12 else f"{z.real:.5f} {'+' if z.imag > 0 else '−'} {abs(z.imag):.5f}i"
