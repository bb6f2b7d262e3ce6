"""The report of `qpal simulate`: what was applied, what was measured, and the truth behind it."""

import numpy as np

from twin.report import figures, style
from twin.report.page import Grid, Page, Picture, Section
from twin.report.units import number
from twin.simulation import Simulation
from twin.versions import versions


def page(result: Simulation) -> Page:
    """The report on one experiment."""
    log = result.log
    lo, hi = np.degrees(result.range).tolist()
    switched_off = ", ".join(log.meta["without"]) or "nothing"
    data = Picture(
        "data",
        style.png(figures.raw_data(log.io())),
        f"Voltage that was commanded and angle that the potentiometer read; switched off: {switched_off}.",
    )
    error = Picture(
        "measurement-error",
        style.png(figures.measurement_error(log.t, log.y, log.y_true)),
        "What the measurement adds to the true angle between the links: noise and the steps of the ADC.",
    )
    return Page(
        title=f"Experiment on the {log.joint}",
        subtitle=f"{log.meta['excitation']}, {log.N} samples, Ts {log.Ts:g} s, seed {log.meta['seed']}",
        verdict=[
            f"The {log.joint} moved between {number(lo, 3)} and {number(hi, 3)} degrees and lay at an end for "
            f"{100 * result.resting:.0f} % of the time."
        ],
        sections=[
            Section("Record", pictures=[data, error]),
            Section("Truth", [_TRUTH], tables=[table(result)]),
        ],
        made_with=versions(),
    )


_TRUTH = "What a perfect identification of this joint would find, at mid stroke."


def table(result: Simulation) -> Grid:
    """The truth of the joint, one row a quantity."""
    t = result.truth
    lo, hi = (number(float(np.degrees(angle)), 4) for angle in t.end_angles)
    down, up = (number(volts, 3) for volts in t.breakaway_voltage)
    rows = [
        ("poles in z", ", ".join(f"{z.real:.5f}" for z in t.poles)),
        ("lag's time constant [s]", number(-1.0 / t.continuous_pole, 3)),
        ("speed per volt [deg/s/V]", number(float(np.degrees(t.gain)), 4)),
        ("ends of travel [deg]", f"{lo} to {hi}"),
        ("backlash, whole width [deg]", number(float(np.degrees(t.backlash)), 3)),
        ("voltage that just moves it, down / up [V]", f"{down} / {up}"),
    ]
    return Grid((f"truth of the {t.joint}", "value"), rows)
