"""The report of `qpal export`: the files, and MJCF beside the fit that it was made from."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import capital, display_quantity, number, poles
from sysid.blocks import ServoMotor
from sysid.data.record import IOData
from sysid.drawing.figure import Figure
from sysid.estimation.joint_parts import is_joint, motor_of
from sysid.estimation.result import Fit
from sysid.export.closed_form import units_of_record
from sysid.plots.free_runs import runs_figure
from sysid.plots.records import Signal, stack_figure
from sysid.report.page import Grid, Listing, Page, Picture, Section
from sysid.workflow.saved import UNFIT
from twin.fragment.rollout import Check
from twin.report.export_answer import answer
from twin.studies.write_back import CLOSE, WrittenModel


def page(result: WrittenModel, folder: str) -> Page:
    """The report on one export into `folder`."""
    source = "the record's input" if result.source.recorded else "a drawn input"
    run = f"Free run of the fit under {source}: the exported code computes this output."
    picture = Picture.of("free-run", free_run_figure(result), run) if result.check is None else None
    sections = [Section("Files", tables=tables(result))]
    if result.fragment is not None and result.check is not None:
        caption = (
            "Angle of the fitted joint and of the MJCF elements in MuJoCo under the same input, and their difference. "
            "The two curves should lie on each other. Peaks of the difference come from struck end stops and "
            "break-away, waves from a linkage that is not quite a quartic."
        )
        picture = Picture.of("mjcf", check_figure(result.check, result.source.data.u_unit), caption)
        sections += [Section("MJCF", listings=[Listing("the file", result.fragment.model())])]
        if result.into is not None:
            listing = Listing("each element that differs, and what goes on acting", "\n".join(result.changes))
            sections.append(Section(f"Changes in {Path(result.into).name}", listings=[listing]))
    said = sentences(result)
    assert picture is not None
    first = answer(result, picture, said, folder)
    return Page("Export", f"Made from {result.source.said}", said, sections, versions(), answer=first)


def tables(result: WrittenModel) -> list[Grid]:
    """The files."""
    return [Grid(("file", "what it is"), result.files, text_columns=2)]


def sentences(result: WrittenModel) -> list[str]:
    """Warnings of the fit, levels of the files, the linear model, what the check found, what the elements lack."""
    trouble = [f"{capital(result.source.trouble)}."] if result.source.trouble else []
    return [*trouble, *_warnings(result), *_levels(result), *_linear(result), *_check_sentences(result)]


def _warnings(result: WrittenModel) -> list[str]:
    """What the saved fit says against itself, the gravest first."""
    warnings = sorted(result.source.fit.warnings, key=lambda text: not text.startswith(UNFIT))
    return [f"{capital(text)}." if text.startswith(UNFIT) else f"Warning of the fit: {text}." for text in warnings]


def _levels(result: WrittenModel) -> list[str]:
    """Which levels of input and output the files have, as a sentence or none."""
    fit = result.source.fit
    if all(name.endswith(".xml") for name, _ in result.files):
        return []
    units = [f"In the files {line}." for line in units_of_record(fit)]
    if fit.u_offset is None or fit.y_offset is None:
        return [
            *units,
            "The model's file has no offsets (a line or what is slow was removed before the fit, or an earlier "
            "version saved it): the files take and give what the fit was made from; remove and add means yourself.",
        ]
    if not (fit.u_offset.any() or fit.y_offset.any()):
        return units
    u0, y0 = (", ".join(f"{v:.6g}" for v in offset) for offset in (fit.u_offset, fit.y_offset))
    return [*units, f"They count from the record's own zero: they take {u0} off the input and add {y0} to the output."]


def _linear(result: WrittenModel) -> list[str]:
    t = result.tangent
    if t is None:
        return []
    place = "the model integrates, so it has no steady state" if t.integrates else "its steady state"
    gain = "" if t.integrates else f", DC gain {number(float(np.sum(t.B) / np.sum(t.F)))}"
    return [
        f"The linear model holds about the input {number(t.u)} and the output {number(t.y)} ({place}): poles "
        f"{poles(np.roots(t.F))}{gain}. It takes and gives deviations from there; choose another input with --at."
    ]


def _check_sentences(result: WrittenModel) -> list[str]:
    """How close the elements come to the fit in MuJoCo, and what they lack."""
    if result.fragment is None or result.check is None:
        return []
    verdict = "do the same" if result.close else "differ"
    texts = [
        f"In MuJoCo, with a light link, the elements and the fit {verdict}: "
        f"RMS {100 * result.check.share:.2f} % of the stroke, at most {100 * result.check.worst:.1f} % "
        f"(up to {100 * CLOSE:g} % RMS counts as the same)."
    ]
    data, fit = result.source.data, result.source.fit
    if result.source.recorded:
        percent = f"{fit.fit_percent(data):.1f} %"
        texts.insert(0, f"The joint follows the record to {percent} (free run, on the record it was fitted to).")
    if result.torque_per_volt is None:
        texts.append("Forces are those of 1 N m per volt; give --torque-per-volt from the motor's data sheet.")
    texts += [f"Not in the elements: {sentence}." for sentence in result.fragment.left_out]
    texts += [f"{capital(sentence)}." for sentence in result.changes]
    if not result.close and not _is_servo(result):
        texts.append(
            "A joint with only the parts that MJCF has comes closer: give the log in place of the fit, "
            "qpal export LOG --mjcf."
        )
    return texts


def _is_servo(result: WrittenModel) -> bool:
    """Whether the joint is a servo's: a log of goals is none of voltages, so that no other joint grows from it."""
    fit = result.source.fit
    return isinstance(fit, Fit) and is_joint(fit.model) and isinstance(motor_of(fit.model), ServoMotor)


def free_run_figure(result: WrittenModel) -> Figure:
    """Input and output of the fit, a panel for each channel."""
    data, fit = result.source.data, result.source.fit
    # A drawn record holds its own free run.
    run = fit.model.outputs(fit.theta, data.u) if isinstance(fit, Fit) and result.source.recorded else data.y
    u, y = display_quantity("input u", data.u_unit), display_quantity("output y", data.y_unit)
    signals = [Signal(u, column, colour=style.INPUT, steps=True) for column in np.atleast_2d(data.u.T)]
    signals += [Signal(y, column, colour=style.MODEL) for column in np.atleast_2d(run.T)]
    return replace(stack_figure(data.t, signals), lettered=False)


def check_figure(check: Check, u_unit: str) -> Figure:
    """Free run of the fit, roll-out of the elements, and their difference."""
    data = IOData(check.u, check.chain, check.Ts, "input u", "angle", u_unit, "rad")
    figure = runs_figure(data, {"MJCF in MuJoCo": check.rolled}, "fit")
    first, *rest = figure.panels
    return replace(figure, panels=[replace(first, title="the fitted joint and its MJCF"), *rest])
