"""The report of `qpal compare`: overlay, error by regime, frequency responses, residual tests and the verdict."""

from collections.abc import Iterator

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import display_quantity, number
from sysid.diagnosis.residuals import ResidualTests
from sysid.joint.values import WORDS as JOINT_WORDS
from sysid.plots.residual_tests import residuals_figure
from sysid.report.answer import short
from sysid.report.page import Grid, Page, Picture, Section
from sysid.report.sections import value_cells
from twin.compare.alignment import Alignment
from twin.compare.comparison import Comparison
from twin.compare.departure import DEFINITIONS
from twin.compare.joints import EFFECTS, Pair
from twin.compare.structures import CAUSES
from twin.compare.verdict import WORTH, Verdict
from twin.report import compare_figures as figures
from twin.report import leg
from twin.report.compare_answer import alignment_rows, answer
from twin.report.compare_words import (
    SMALLEST,
    UNKNOWN,
    WORDS,
    deg,
    sentences,
    share_text,
    shown,
    verdict_sentences,
)


def page(result: Comparison, file: str) -> Page:
    """The report on one comparison."""
    words = sentences(result, file)
    overlay = Picture.of("overlay", short(figures.overlay_figure(result)), _overlay_caption(result))
    return Page(
        title=f"The {result.joint} beside {result.label}",
        subtitle=f"{file}, {len(result.y)} samples, Ts {result.Ts:g} s",
        verdict=words,
        sections=list(_sections(result)),
        made_with=versions(),
        answer=answer(result, overlay, words),
    )


def _sections(result: Comparison) -> Iterator[Section]:
    """The sections of the page, of which the twin alone has all."""
    regimes = Picture.of("regimes", figures.regimes_figure(result), _regime_caption(result))
    yield Section("Record", pictures=[regimes, _leg(result)], tables=[regime_table(result)])
    if result.verdict is not None and result.verdict.chance:
        yield Section("Physical effects", [_METHOD, _without_effect(result.verdict)])
    elif result.verdict is not None:
        tables = [effect_table(result.verdict), *_change_tables(result.verdict)]
        effects = Picture("effects", style.png(figures.effects(result.verdict)), _effect_caption(result.verdict))
        yield Section("Physical effects", [_METHOD], tables=tables, pictures=[effects])
    if result.alignment is not None:
        yield Section("Alignment", result.alignment.sentences(), tables=[alignment_table(result.alignment)])
    if result.pairs:
        yield Section("The actuated joint, fitted to both", [_PAIRS], tables=[pair_table(result)])
    yield _response(result)
    if result.tests is not None:
        picture = Picture.of("residuals", residuals_figure(result.tests), _tests_caption(result.tests))
        yield Section("Residual tests", pictures=[picture])


def _response(result: Comparison) -> Section:
    """The frequency responses, or why the log shows none."""
    title = "Frequency response"
    if result.spectra is None:
        return Section(title, ["The log shows no frequency response: its input is constant, or a ramp without steps."])
    if not all(spectrum.known.any() for spectrum in result.spectra):
        return Section(title, ["The log is too short to show a frequency response: it may be zero everywhere."])
    return Section(title, pictures=[Picture.of("spectra", figures.spectra_figure(result), _spectra_caption(result))])


_METHOD = (
    "Each effect's values are moved in the twin until it fits the log best; the share is what vanishes of the "
    "departure beyond noise. The angle of the drive at the first sample is free throughout. An effect that fell far "
    "behind after the first steps was not followed to its end: its share may be somewhat larger."
)
_PAIRS = (
    "The joint grew on the log and was fitted to the twin's own log of the same input, noise included. What this model "
    "lacks is missing on both sides, so differences mean more than the values. Intervals of 95 %."
)


def _leg(result: Comparison) -> Picture:
    """Both legs, with nominal lengths."""
    log_name, twin_name = figures.names(result)
    return leg.picture("leg", result.t, {log_name: {result.joint: result.y}, twin_name: {result.joint: result.other}})


def tables(result: Comparison) -> list[Grid]:
    """The tables of the terminal."""
    grids = [regime_table(result)]
    if result.alignment is not None:
        grids.append(alignment_table(result.alignment))
    if result.verdict is not None and not result.verdict.chance:
        grids.append(effect_table(result.verdict))
    if result.pairs:
        grids.append(pair_table(result))
    return grids


def regime_table(result: Comparison) -> Grid:
    """Share of samples, RMS error and share of the squared error of every regime, with its definition."""
    rows = [
        (
            regime.name,
            share_text(regime.share),
            number(display_quantity("", "rad").factor * regime.rms, 3) if regime.share else "–",
            share_text(regime.of_error),
            DEFINITIONS[regime.name],
        )
        for regime in result.regimes
    ]
    headings = ("regime", "share of the record", "RMS of the error [deg]", "share of the error", "definition")
    return Grid(headings, rows, last_text=True)


def alignment_table(alignment: Alignment) -> Grid:
    """Delay, gear and offset with their intervals."""
    note = (
        "On legs that differ from the twin in nine values at once these intervals held the true value 17 times of 21."
    )
    headings = ("log over twin", "value", "95 % interval", "unit")
    return Grid(headings, alignment_rows(alignment), last_text=True, note=note)


def effect_table(verdict: Verdict) -> Grid:
    """The effects that explain something when moved alone, best first; the note names the others."""
    rows, factor = [], display_quantity("", "rad").factor
    for share in figures.telling(verdict):
        rows.append((CAUSES[share.effect].words, share_text(share.share), number(factor * share.rms, 3)))
    headings = ("effect, moved alone", "departure that vanishes", "RMS left [deg]")
    return Grid(headings, rows, note=_others(verdict))


def _others(verdict: Verdict) -> str:
    """The effects that explain nothing."""
    telling = figures.telling(verdict)
    names = [CAUSES[share.effect].words for share in verdict.alone if share not in telling]
    return f"Moved alone, these explain less than {100 * WORTH:g} %: {', '.join(names)}." if names else ""


def _change_tables(verdict: Verdict) -> list[Grid]:
    """The values that the named effects move, in one table or none."""
    rows = []
    for share in verdict.named:
        for change in share.changes:
            unit = display_quantity("", change.log.unit)
            rows.append(
                (
                    CAUSES[share.effect].words,
                    WORDS.get(change.name, change.name),
                    number(unit.factor * change.twin, 4),
                    *shown(change.log, unit.factor, UNKNOWN),
                    unit.unit,
                )
            )
    headings = ("effect", "value", "twin", "log", "95 % interval of the log", "unit")
    return [Grid(headings, rows, text_columns=2, last_text=True)] if rows else []


def pair_table(result: Comparison) -> Grid:
    """Values of the actuated joint on both sides."""
    rows = [pair_row(pair) for pair in result.pairs]
    headings = ("value", "effect", "log", "its 95 % interval", "twin", "its 95 % interval", "unit", "differ")
    return Grid(headings, rows, text_columns=2, last_text=True)


def pair_row(pair: Pair) -> tuple[str, ...]:
    """A value of both sides, and whether they differ."""
    (log, span, unit), (other, other_span, _) = value_cells(pair.log), value_cells(pair.other)
    differ = {True: "yes", False: "no", None: "cannot tell"}[pair.apart]
    name = JOINT_WORDS.get(pair.name, pair.name)
    return (name, CAUSES[EFFECTS[pair.name]].words, log, span, other, other_span, unit, differ)


def _overlay_caption(result: Comparison) -> str:
    return (
        f"The log and {result.label} under the same input; below, log less {result.label}. What to see: errors outside "
        f"the band, twice the noise of the log ({deg(result.noise)})."
    )


def _regime_caption(result: Comparison) -> str:
    worst = max(result.regimes, key=lambda regime: regime.rms)
    return (
        f"(a) RMS of the error in each regime of the log; (b) the share of the record that each regime is, and of the "
        f"squared error that it makes. The error is largest in the regime '{worst.name}', {deg(worst.rms)} RMS."
    )


def _effect_caption(verdict: Verdict) -> str:
    """What the bars of the effects show, and which is longest."""
    best, longest = verdict.alone[0], max(verdict.alone, key=lambda share: share.share)
    text = (
        "Share of the departure that vanishes when one cause alone is moved to fit the log. Filled: those that the "
        f"verdict {'names' if verdict.known else 'finds nearest, and does not name'}. The best alone is "
        f"{CAUSES[best.effect].words}, {share_text(best.share)}"
    )
    if share_text(longest.share) == share_text(best.share):
        return f"{text}."
    return (
        f"{text}; {CAUSES[longest.effect].words}, {share_text(longest.share)}, stands behind it because it moves more "
        "values (BIC)."
    )


def _without_effect(verdict: Verdict) -> str:
    """That no effect explains anything, and what the best one leaves."""
    best = min(verdict.alone, key=lambda share: share.rms)
    return (
        f"No cause, moved alone, makes the error of {deg(verdict.rms)} RMS smaller by more than chance does and "
        f"{SMALLEST}: the best one, {CAUSES[best.effect].words}, leaves {deg(best.rms)}."
    )


def _spectra_caption(result: Comparison) -> str:
    assert result.spectra is not None
    return (
        f"Frequency response from voltage to angle of the log and of {result.label}, both by "
        f"{result.spectra[0].method}, with 95 % bands. Where the bands do not overlap, the two differ in their linear "
        "part; a joint with friction and stops has wide bands, because its nonlinearity acts like noise."
    )


def _tests_caption(tests: ResidualTests) -> str:
    subject = f"Correlations of the error with itself ({tests.whiteness_outside} of {len(tests.lags) - 1} lags out)"
    white, independent = tests.verdicts
    if not tests.cross_correlation.any():  # a constant input
        return f"{subject}: {white}. {tests.rule}"
    return f"{subject}: {white}; and with the input, {independent}. {tests.rule}"


__all__ = ["effect_table", "page", "pair_table", "sentences", "tables", "verdict_sentences"]
