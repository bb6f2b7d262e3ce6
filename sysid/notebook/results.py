"""What records, searches, comparisons and tests show at a prompt and in a notebook, one class each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sysid.base.errors import InputError
from sysid.base.quantities import capital, display_quantity, number, percent, pole, probability
from sysid.data.record import IOData
from sysid.diagnosis.residuals import ResidualTests
from sysid.joint.posterior import JointFit
from sysid.linear.modes import Modes
from sysid.notebook.card import Card, Table
from sysid.notebook.fits import FitView, own_percent, parameter_table
from sysid.notebook.page import figure
from sysid.notebook.poles import pole_table
from sysid.plots.comparison import comparison
from sysid.plots.records import record
from sysid.plots.usual import usual
from sysid.report.joint import PARTS_SAY, rows
from sysid.selection.table import Selection
from sysid.validation.compare import Comparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NOTHING = 1e-12  # of the largest value: what rounding leaves of a mean that was removed
ROWS = 12


class IODataView:
    """A record at a prompt and in a notebook."""

    @staticmethod
    def line(data: IOData) -> str:
        """Size, rate and channels."""
        spread = f" in {len(data.lengths)} experiments" if len(data.lengths) > 1 else ""
        return (
            f"<IOData: {data.N} samples{spread} every {data.Ts:g} s, {_channels(data, 'u')} to {_channels(data, 'y')}>"
        )

    @staticmethod
    def card(data: IOData) -> Card:
        """The same with the range of every channel."""
        facts = [
            ("samples", f"{data.N} every {data.Ts:g} s, {data.N * data.Ts:g} s in all"),
        ]
        if len(data.lengths) > 1:
            shown_lengths = ", ".join(map(str, data.lengths[:8])) + (", ..." if len(data.lengths) > 8 else "")
            facts.append(("experiments", f"{len(data.lengths)}, of {shown_lengths} samples"))
        missing = int((~data.observed).sum())
        if missing:
            facts.append(("missing", f"{missing} output samples, {100 * missing / data.y.size:.2g} %"))
        rows: list[tuple[str, ...]] = []
        for side, values, offsets in (("u", data.u, data.u_offset), ("y", data.y, data.y_offset)):
            name, unit = (data.u_name, data.u_unit) if side == "u" else (data.y_name, data.y_unit)
            for k in range(values.shape[1]):
                q, channel_name = display_quantity(name, unit), name if values.shape[1] == 1 else f"{name}{k + 1}"
                x = values[:, k] * q.factor
                size = float(np.abs(x).max())
                result = (x.min(), x.max(), x.mean(), x.std(), offsets[k] * q.factor)
                cells = (number(float(v) if abs(v) > _NOTHING * size else 0.0) for v in result)
                rows.append((channel_name, "input" if side == "u" else "output", q.unit or "–", *cells))
        headings: tuple[str, ...] = ("channel", "", "unit", "least", "largest", "mean", "std", "removed")
        if not np.any(data.u_offset) and not np.any(data.y_offset):
            headings, rows = headings[:-1], [row[:-1] for row in rows]
        calls = "data.plot(), data.between(start, stop), sysid.advise(data), sysid.fit(model, data)"
        return Card("Record", facts, [Table(headings, rows, text_columns=3)], call=f"Next: {calls}")

    @staticmethod
    def plot(data: IOData) -> Figure:
        """Every channel over time."""
        say = "What to see: the input should move at the speeds and over the levels that matter, "
        say += "and the output answer it."
        return figure(record, data, say=say)


def _channels(data: IOData, side: str) -> str:
    name, unit, n = (data.u_name, data.u_unit, data.u.shape[1])
    if side == "y":
        name, unit, n = (data.y_name, data.y_unit, data.y.shape[1])
    return f"{f'{n} x ' if n > 1 else ''}{name}{f' [{unit}]' if unit else ''}"


class JointFitView:
    """A joint with all its parts."""

    @staticmethod
    def line(joint: JointFit) -> str:
        """The parts that the record shows, and the fit."""
        shown = ", ".join(joint.shown) or "no part shown"
        return f"<JointFit: {shown}; {FitView.line(joint.fit).strip('<>')}>"

    @staticmethod
    def card(joint: JointFit) -> Card:
        """The parts on one screen."""
        fit = joint.fit
        score = own_percent(fit)
        facts = [] if score is None else [("fit, free run", f"{percent(score)} on its own record")]
        if math.isfinite(joint.unseen_percent):
            facts.append(("on unseen parts", percent(joint.unseen_percent)))
        facts += [("searches that agree", f"{joint.agreed} of {joint.tried}"), ("search", f"{fit.stop.reason}")]
        lines = [
            (p.words, number(p.value, 4), number(p.std, 2), f"{number(p.usual, 4)} ± {number(p.spread, 2)}", p.verdict)
            for p in joint.parts
        ]
        table = Table(("part", "value", "deviation", "usual", "record"), lines, "Parts", text_columns=1)
        sentences = [joint.sentence(), *(f"Warning: {text}." for text in joint.warnings[:3])]
        calls = "joint.plot(), joint.fit, sysid.joint_values(joint.fit)"
        details = [parameter_table(fit)]
        return Card("Actuated joint", facts, [table] if lines else [], sentences, details, call=f"Next: {calls}")

    @staticmethod
    def plot(joint: JointFit) -> Figure:
        """The parts beside what is usual."""
        if not joint.parts:
            raise InputError("this joint has no part to draw; see joint.fit.plot()")
        return figure(usual, rows(joint.parts), say=PARTS_SAY)


class SelectionView:
    """A structure search."""

    @staticmethod
    def line(result: Selection) -> str:
        """The chosen candidate."""
        row = result.chosen
        fit = percent(row.fit_percent)
        return f"<Selection: {row.candidate}, {fit} on unseen data, d {row.d}; {len(result.rows)} candidates>"

    @staticmethod
    def card(result: Selection) -> Card:
        """The best candidates on one screen."""
        rows = []
        for k, row in enumerate(result.rows, 1):
            c = row.candidate
            maps = " / ".join(name.replace("_", " ") for name in c.maps.values()) or "–"
            mark = "chosen" if c == result.chosen.candidate else "equal" if row.equal else row.why.partition(";")[0]
            rows.append((str(k), c.short, maps, mark, percent(row.fit_percent), str(row.d)))
        table = Table(("", "structure", "maps", "", "fit on unseen data", "d"), rows, "", text_columns=4, most=ROWS)
        notes = [f"{capital(note)}." for note in result.notes]
        facts = [("search", f"{result.seconds:.0f} s, {len(result.rows)} candidates")]
        details = [Table(table.headings, rows, f"All {len(rows)} candidates", text_columns=4)]
        calls = "selection.fit, selection.fit.plot(), selection.rows"
        return Card("Structure search", facts, [table], [result.sentence(), *notes], details, call=f"Next: {calls}")


class ComparisonView:
    """A comparison of fits."""

    @staticmethod
    def line(table: Comparison) -> str:
        """The best model."""
        best = table.rows[0]
        return (
            f"<Comparison: {len(table.rows)} models on {table.scored} samples; best {best.label}, {percent(best.fit)}>"
        )

    @staticmethod
    def card(table: Comparison) -> Card:
        """The ranking."""
        q = display_quantity("RMSE", table.y_unit)
        rows = [
            (
                str(r.rank),
                r.label,
                "converged" if r.converged else "not converged",
                percent(r.fit),
                number(r.rmse * q.factor),
                "–" if r.one_step is None else percent(r.one_step),
                str(r.criteria.d),
                *r.criteria.brief().values(),
            )
            for r in table.rows
        ]
        labels = table.rows[0].criteria.brief()
        headings = ("", "model", "search", "free run", q.label, "one step ahead", "d", *labels)
        facts = [
            ("scored", f"{table.scored} samples; the first {table.n_init} of each experiment give the initial state")
        ]
        if table.numbered:
            facts.append(("model", table.numbered))
        return Card(
            "Comparison", facts, [Table(headings, rows, text_columns=3, most=20)], call="Next: comparison.plot()"
        )

    @staticmethod
    def plot(table: Comparison) -> Figure:
        """The free-run fits as bars."""
        say = "What to see: the longest bar has the best free run; of models that are equally good, "
        say += "prefer the smallest d."
        return figure(comparison, table, say=say)


class ResidualTestsView:
    """Residual tests."""

    @staticmethod
    def line(tests: ResidualTests) -> str:
        """Both verdicts."""
        return f"<ResidualTests: {_white(tests)}, {_independent(tests)}; {len(tests.lags) - 1} lags>"

    @staticmethod
    def card(tests: ResidualTests) -> Card:
        """The verdicts, what they rest on, and what they mean."""
        n, lags, level = len(tests.lags) - 1, len(tests.cross_lags), f"{100 * tests.level:.3g} %"
        rows = [
            (
                "residuals with themselves",
                _white(tests),
                f"{tests.whiteness_outside} of {n}",
                _bound_text(tests.whiteness_bound),
            ),
            (
                "residuals with the input",
                _independent(tests),
                f"{tests.independence_outside} of {lags}",
                _bound_text(tests.independence_bound),
            ),
        ]
        table = Table(("correlation", "verdict", "lags outside", f"bound, {level}"), rows, text_columns=2)
        facts = [
            ("lags", f"1 to {n} samples, with the input −{n} to {n}"),
            ("chance", f"{probability(tests.independence_p)} that the input is independent and gives this by chance"),
        ]
        call = 'Next: fit.plot(data, "residuals"), fit.noise_model(data)'
        return Card("Residual tests", facts, [table], [_meaning(tests)], call=call)


def _white(tests: ResidualTests) -> str:
    return "white" if tests.white else "not white"


def _independent(tests: ResidualTests) -> str:
    return "independent" if tests.independent else "not independent"


def _bound_text(value: float) -> str:
    return f"± {number(value, 2)}"


def _meaning(tests: ResidualTests) -> str:
    """What the two verdicts say about the model."""
    if not tests.independent:
        return (
            "The residuals depend on the input: the model misses something that the input does. Try another delay, "
            "higher orders or another structure: sysid.select(data)."
        )
    if not tests.white:
        return "The residuals are coloured: the noise is, or the model lacks dynamics; see fit.noise_model(data)."
    return "What the model leaves is noise: the record shows nothing that it misses."


class ModesView:
    """The modes of a fit."""

    @staticmethod
    def line(result: Modes) -> str:
        """The poles, each pair once."""
        start = ", ".join(pole(m.pole) for m in result[:6] if m.pole.imag > -1e-9)
        return f"<Modes: {len(result)} poles{f', {start}' if start else ''}{', ...' if len(result) > 6 else ''}>"

    @staticmethod
    def card(result: Modes) -> Card:
        """The table of poles, and how to have their numbers."""
        table = pole_table(result)
        call = "Next: modes[0].hertz, modes[0].damping, modes[0].time_constant, each with its _std"
        if table is None:
            return Card("Modes", sentences=["The model has no linear block, so it has no poles."])
        return Card("Modes", tables=[table], call=call)
