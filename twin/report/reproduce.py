"""The report of `qpal reproduce`: the paper's protocol, joint by joint, in the order of its figures 17 to 40."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from sysid import plots
from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import number, percent, poles
from sysid.report import sections
from sysid.report.figures import TABLE, VALIDATION_TIME
from sysid.report.page import Grid, Page, Picture, Section
from sysid.report.verdict import tests_in_words
from sysid.workflow.results import Evaluation
from twin.report import actuated_joint
from twin.studies.beyond import RECORDS
from twin.studies.protocol import TS, JointResult, ProtocolResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# The paper's number of each figure, by joint. The twin's figure with that number shows the same quantity.
NUMBERS = {
    "raw": {"shoulder": 17, "thigh": 18, "shank": 19},
    "preprocessed": {"shoulder": 20, "thigh": 21, "shank": 22},
    "default": {"shoulder": 23, "thigh": 24, "shank": 25},
    "output": {"shoulder": 26, "thigh": 30, "shank": 34},
    "close-up": {"shoulder": 27, "thigh": 31, "shank": 35},
    "step": {"shoulder": 28, "thigh": 32, "shank": 36},
    "pole-zero": {"shoulder": 29, "thigh": 33, "shank": 37},
    "residuals": {"shoulder": 38, "thigh": 39, "shank": 40},
}
SHOWN = {"shoulder": 10.0, "thigh": 30.0, "shank": 30.0}  # [s] of raw data and output: a few sweeps


Stills = list[tuple[str, str, np.ndarray]] | str  # pictures, or a sentence with the reason why there are none


def page(result: ProtocolResult, stills: Stills) -> Page:
    """The report; `stills` are the pictures of the leg, or a sentence with the reason why there are none."""
    return Page(
        title="Identification of a robot leg",
        subtitle=(
            f"The protocol of Guni and Irawan (2016) on the digital twin of the QPAL leg: {result.duration:g} s per "
            f"joint, Ts {TS:g} s, estimation on the first half, validation on the second, seed {result.seed}"
        ),
        verdict=sentences(result),
        sections=[
            _leg(stills),
            Section("Results", [_READING], tables=[table(result)]),
            Section("Truth", [_TRUTH], tables=[truth_table(result), checks_table(result)]),
            actuated_joint.section(result),
            *sections.only([actuated_joint.ablation_section(result)]),
            *(_joint(r) for r in result.joints),
        ],
        made_with=versions(),
    )


_READING = (
    "Fit is 100 (1 − ‖y − ŷ‖ / ‖y − mean y‖) of a free run over the second half, which uses only the input. The "
    "ceiling is the fit of the twin's noise-free output to the recorded potentiometer output: no model can be "
    "expected to do better. Default and final models are Hammerstein-Wiener with orders nb, nf, nk. NLARX has orders "
    "na, nb, nk and a wavelet network, and is fitted to one-step-ahead errors. In the row ONE STEP it uses every "
    "measured output up to the previous sample, so do not compare this fit with any other. Loss and FPE are in rad². "
    "The paper does not print its unit, so these two columns compare orders of magnitude at most. The paper's rows "
    "are grey."
)
_TRUTH = (
    "At mid stroke, without dry friction, backlash, stops and gravity, the twin is a first-order lag and an "
    "integrator. The table compares the poles of the linearised compiled model with those calculated from motor and "
    "load constants. A Hammerstein-Wiener model has neither end stops nor backlash, so its poles may differ from "
    "these; the difference is a limit of the structure."
)


def sentences(result: ProtocolResult) -> list[str]:
    """The outcome in plain words."""
    fits = ", ".join(
        f"{r.joint} {percent(r.final.validation_fit)} (paper {r.paper.validation_fit:.2f} %)" for r in result.joints
    )
    ceilings = ", ".join(f"{r.ceiling:.1f} %" for r in result.joints)
    networks = ", ".join(percent(r.nlarx.validation_fit) for r in result.joints)
    fits_sentence = (
        "Each joint of the simulated leg was swept between its ends, and the paper's Hammerstein-Wiener structures "
        f"were fitted to the first half of the record. Their free-run fits on the second half are: {fits}. The "
        f"default NLARX models reach {networks}; the ceilings set by noise are {ceilings}. The sweep repeats itself, "
        "so a high fit does not mean that the model describes the leg: compare its poles with the truth below."
    )
    failures = [f"DOES NOT HOLD – {check.statement}: {check.found}." for check in result.checks if not check.holds]
    success = f"All {len(result.checks)} checks hold: the models are stable and the twin agrees with its closed form."
    return [fits_sentence, *actuated_joint.sentences(result), *(failures or [success])]


def table(result: ProtocolResult) -> Grid:
    """The main table: every model and the paper's row."""
    headings = ("joint", "model", "search", "fit", "ceiling", "FPE", "loss", "stable", "white, indep.", "poles")
    rows, quiet = [], set()
    for r in result.joints:
        rows += [*_nlarx_rows(r), _row(r, "default", r.default), _row(r, "final", r.final), _paper_row(r)]
        quiet.add(len(rows) - 1)
    return Grid(headings, rows, text_columns=3, quiet_rows=frozenset(quiet), last_text=True)


def _row(r: JointResult, name: str, e: Evaluation) -> tuple[str, ...]:
    return (
        *_start(r, name, e),
        percent(r.ceiling),
        *_losses(e),
        _yes(e.stable),
        _residual_verdicts(e),
        poles(e.poles),
    )


def _nlarx_rows(r: JointResult) -> list[tuple[str, ...]]:
    """The free run of the NLARX model, and its one-step-ahead prediction."""
    e, one_step = r.nlarx, r.nlarx.one_step
    assert one_step is not None
    free_run = (*_start(r, "NLARX", e), percent(r.ceiling), "–", "–", _yes(e.stable), "–", "–")
    start = (r.joint, "NLARX, ONE STEP", e.setting.search, percent(one_step.validation_fit), "–")
    return [free_run, (*start, *_losses(e), "–", _residual_verdicts(e), "–")]


def _start(r: JointResult, name: str, e: Evaluation) -> tuple[str, str, str, str]:
    return r.joint, f"{name} {e.setting.recipe.order_text}", e.setting.search, percent(e.validation_fit)


def _losses(e: Evaluation) -> tuple[str, str]:
    return number(e.fit.criteria.fpe, 3), number(e.fit.criteria.loss, 3)


def _residual_verdicts(e: Evaluation) -> str:
    return "–" if e.tests is None else f"{_yes(e.tests.white)}, {_yes(e.tests.independent)}"


def _paper_row(r: JointResult) -> tuple[str, ...]:
    p, s = r.paper, r.paper.setting
    name = f"paper {s.recipe.order_text}"
    fit = f"{p.validation_fit:.2f} %"
    return (r.joint, name, s.search, fit, "–", number(p.fpe, 3), number(p.loss, 3), "yes", "claimed", poles(p.poles))


def truth_table(result: ProtocolResult) -> Grid:
    """True poles, the closed form and the other true values of each joint, in practical units."""
    rows = []
    for r in result.joints:
        t = r.truth
        low, high = (number(float(np.degrees(angle)), 3) for angle in t.end_angles)
        rows.append(
            (
                r.joint,
                *(", ".join(f"{z.real:.5f}" for z in zs) for zs in (t.poles, t.closed_form_poles)),
                number(float(np.degrees(t.gain)), 3),
                f"{low} to {high}",
                f"{np.degrees(t.backlash):.2f}",
                " / ".join(number(volts, 3) for volts in t.breakaway_voltage),
            )
        )
    quantities = (
        "poles, twin",
        "closed form",
        "gain [deg/s/V]",
        "end stops [deg]",
        "backlash [deg]",
        "break-away voltage [V]",
    )
    return Grid(("joint", *quantities), rows)


def checks_table(result: ProtocolResult) -> Grid:
    """Every check with its result."""
    rows = [(check.statement, check.found, "yes" if check.holds else "NO") for check in result.checks]
    return Grid(("check", "found", "holds"), rows, text_columns=1)


def tables(result: ProtocolResult) -> list[Grid]:
    """The same numbers in tables that fit a terminal of 80 columns."""
    results, truth = table(result), truth_table(result)
    return [
        results.only("joint", "model", "search", "fit", "ceiling", "FPE", "loss"),
        results.only("joint", "model", "stable", "white, indep.", "poles"),
        truth.only("joint", "poles, twin", "closed form", "end stops [deg]", "backlash [deg]"),
        actuated_joint.table(result),
        actuated_joint.values_table(result).only("joint", "value", "truth", "aim ±", *RECORDS),
    ]


def _leg(stills: Stills) -> Section:
    if isinstance(stills, str):
        return Section("The leg", [f"The 3-D stills are missing: {stills}."])
    pictures = [
        Picture(f"leg-{joint}-{end}", style.image_png(rgb), f"{joint.capitalize()} at its {end}imum angle.")
        for joint, end, rgb in sorted(stills, key=lambda item: item[1], reverse=True)  # all minima, then all maxima
    ]
    lead = "Each joint at both ends of its travel, as figures 14 to 16 of the paper; only the excited leg moves."
    return Section("The leg", [lead], pictures=pictures, small_pictures=True)


def _joint(r: JointResult) -> Section:
    """The section of a joint: its final model in words, the figures, all parameters."""
    lead = (
        f"{sections.sentence(sections.setting_in_words(r.final))} {tests_in_words(r.final)} "
        f"{sections.search_sentence(r.final)}"
    )
    notes = [f"Note: {note}." for note in r.final.notes]
    return Section(
        r.paper.title,
        [lead, *notes],
        pictures=list(_pictures(r)),
        details=[sections.parameter_grid(r.final, "All parameters of the final model")],
    )


def _pictures(r: JointResult) -> Iterator[Picture]:
    """The figures of a joint in the order of the paper."""
    io, final = r.log.io(), r.final
    seconds = SHOWN[r.joint]
    yield Picture(
        _name("raw", r),
        style.png(plots.record(io, seconds=seconds)),
        f"{_lead('raw', r)}The first {seconds:g} s as recorded: the angle follows the voltage and rests at end stops.",
    )
    yield Picture(
        _name("preprocessed", r),
        style.png(plots.parts(final.estimation, final.validation)),
        f"{_lead('preprocessed', r)}The record without its means; the first half is for estimation, the second for "
        "validation.",
    )
    yield Picture(
        _name("default", r),
        style.png(_free_runs({"(a) NLARX": r.nlarx, "(b) Hammerstein-Wiener": r.default}, seconds)),
        f"{_lead('default', r)}Free runs of the two default models over the first {seconds:g} s of the validation "
        f"half. One-step-ahead prediction, which is not a free run, gives {_one_step(r)} with NLARX.",
    )
    yield Picture(
        _name("output", r),
        style.png(_free_runs({"": final}, seconds)),
        f"{_lead('output', r)}Free run of the final model over the same seconds; a perfect model would reach "
        f"{r.ceiling:.1f} %.",
    )
    references = {"truth": r.truth.poles, "paper": np.array(r.paper.poles, dtype=complex)}
    for kind, file, options in (
        ("close-up", "close-up", {}),
        ("step", "step-response", {}),
        ("pole-zero", "pole-zero", {"references": references}),
        ("residuals", "residuals", {}),
    ):
        yield from sections.only([TABLE[file].picture(_name(kind, r), final, _lead(kind, r), **options)])
    yield from sections.only([TABLE["static-maps"].picture(f"{r.joint}-static-maps", final)])


def _free_runs(evaluations: dict[str, Evaluation], seconds: float) -> "list[Axes]":
    runs = [plots.Run(e.validation, e.validation_output, e.validation_fit, title) for title, e in evaluations.items()]
    return plots.free_runs(runs, seconds=seconds, time=VALIDATION_TIME)


def _one_step(r: JointResult) -> str:
    assert r.nlarx.one_step is not None
    return percent(r.nlarx.one_step.validation_fit)


def _name(kind: str, r: JointResult) -> str:
    return f"{NUMBERS[kind][r.joint]}-{r.joint}-{kind}"


def _lead(kind: str, r: JointResult) -> str:
    return f"Figure {NUMBERS[kind][r.joint]}. "


def _yes(value: bool) -> str:
    return "yes" if value else "no"
