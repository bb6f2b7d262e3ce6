"""The report of `qpal simulate`: the applied input, the measured output and the truth."""

import numpy as np

from sysid.base.files import versions
from sysid.base.quantities import number
from sysid.plots.records import lines_figure, record_figure
from sysid.report.page import Grid, Page, Picture, Section
from twin.parameters import Parameters
from twin.report import leg
from twin.studies.simulation import Part, Simulation


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
        f"The {part.joint} moved between {number(lo, 3)} and {number(hi, 3)} degrees and rested at an end stop for "
        f"{100 * part.resting:.0f} % of the time."
    )


def _leg(result: Simulation) -> Picture:
    """The leg as the experiment moved it, with the lengths of its own parameters."""
    parameters = Parameters().replace(dict(result.log.meta.get("parameters_changed", {})))
    angles = {part.joint: part.y_true for part in result.parts}
    return leg.picture("leg", result.parts[0].data.t, {"twin": angles}, parameters)


def _pictures(part: Part, mode: str, switches: list[str]) -> list[Picture]:
    """The record of a joint, and the error of its reading."""
    data, present = part.data, f"without {', '.join(switches)}" if switches else "with every imperfection"
    error = {"error": data.y[:, 0] - part.y_true}
    return [
        Picture.of(
            f"data-{part.joint}",
            record_figure(data),
            f"{_INPUT[mode]} and angle that the potentiometer read, {part.joint}, {present}.",
        ),
        Picture.of(
            f"measurement-error-{part.joint}",
            lines_figure(data.t, error, "error", "rad", "measured less true angle"),
            f"Error of the {part.joint}'s reading from noise, ADC steps and missed samples. A missed sample repeats "
            "the previous one, so it appears as a spike while the joint moves.",
        ),
    ]


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
        ("end stops [deg]", f"{lo} to {hi}"),
        ("backlash, whole width [deg]", number(float(np.degrees(t.backlash)), 3)),
        ("break-away voltage, down / up [V]", f"{low_volts} / {high_volts}"),
        ("dead band of the drive [V]", number(t.dead_band, 3)),
        ("delay of the command [s]", number(t.delay, 3)),
    ]
    return Grid((f"truth of the {t.joint}", "value"), rows)


def _pole(z: complex) -> str:
    return f"{z.real:.5f}" if abs(z.imag) < 1e-12 else f"{z.real:.5f} {'+' if z.imag > 0 else '−'} {abs(z.imag):.5f}i"
