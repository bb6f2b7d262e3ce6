"""The report of `qpal export`: the files, and MJCF beside the fit that it was made from."""

from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.style import styled
from sysid.base.versions import versions
from sysid.report.page import Grid, Listing, Page, Picture, Section
from twin.fragment import Check
from twin.studies.write_back import CLOSE, Written

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def page(result: Written) -> Page:
    """The report on one export."""
    under = "the record's input" if result.source.recorded else "a drawn input"
    run = f"Free run of the fit under {under}: the exported code computes this output."
    files = Section("Files", tables=tables(result), pictures=[Picture("free-run", style.png(free_run(result)), run)])
    sections = [files]
    if result.fragment is not None and result.check is not None:
        caption = (
            "Angle of the fitted joint and of the MJCF elements in MuJoCo under the same input, and their difference. "
            "The two curves should lie on each other. Peaks of the difference come from struck stops and break-away, "
            "waves from a linkage that is not quite a quartic."
        )
        sections += [
            Section("Check in MuJoCo", pictures=[Picture("mjcf", style.png(overlay(result.check)), caption)]),
            Section("MJCF", listings=[Listing("the file", result.fragment.model())]),
        ]
    return Page("Export", f"Made from {result.source.said}", sentences(result), sections, versions())


def tables(result: Written) -> list[Grid]:
    """The files."""
    return [Grid(("file", "what it is"), result.files, text_columns=2)]


def sentences(result: Written) -> list[str]:
    """What the check found, and what the elements cannot hold."""
    if result.fragment is None or result.check is None:
        return []
    verdict = "do the same" if result.close else "differ"
    said = [
        f"In MuJoCo, with a light link, the elements and the fit {verdict}: "
        f"RMS {100 * result.check.share:.2f} % of the stroke, at most {100 * result.check.worst:.1f} % "
        f"(up to {100 * CLOSE:g} % RMS counts as the same)."
    ]
    data, fit = result.source.data, result.source.fit
    if result.source.recorded:
        percent = f"{fit.fit_percent(data):.1f} %"
        said.insert(0, f"The joint follows the record to {percent} (free run, on the record it was fitted to).")
    if result.torque_per_volt is None:
        said.append("Forces are those of 1 N m per volt; give --torque-per-volt from the motor's data sheet.")
    said += [f"Not in the elements: {sentence}." for sentence in result.fragment.left_out]
    if not result.close:
        said.append(
            "A joint with only the parts that MJCF has comes closer: give the log in place of the fit, "
            "qpal export LOG --mjcf."
        )
    return said


@styled
def free_run(result: Written) -> "Axes":
    """Input and output of the fit."""
    data, fit = result.source.data, result.source.fit
    first, second = style.panels(None, rows=2, height=4.2, sharex=True)
    for axes, values, name in ((first, data.u, "input u"), (second, fit.model.simulate(fit.theta, data.u), "output y")):
        unit = data.u_unit if axes is first else data.y_unit
        columns = np.atleast_2d(values.T)
        for k, column in enumerate(columns):
            style.line(axes, data.t[: len(column)], column, steps=axes is first, label=f"{name[-1]}{k + 1}")
        axes.set(ylabel=f"{name} [{unit}]" if unit else name)
        if len(columns) > 1:
            style.legend(axes)
    second.set(xlabel="time [s]")
    return second


@styled
def overlay(check: Check) -> "Axes":
    """Free run of the fit, roll-out of the elements, and their difference, in degrees."""
    first, second = style.panels(None, rows=2, height=4.2, sharex=True)
    t = np.arange(len(check.u)) * check.Ts
    style.line(first, t, np.degrees(check.chain), label="fit")
    style.line(first, t, np.degrees(check.rolled), color="black", label="MJCF in MuJoCo", linestyle=":", linewidth=1.6)
    first.set(ylabel="angle [deg]", title="the fitted joint and its MJCF")
    style.legend(first)
    style.line(second, t, np.degrees(check.rolled - check.chain), color=style.SECOND, linewidth=0.8)
    second.set(xlabel="time [s]", ylabel="difference [deg]")
    return second
