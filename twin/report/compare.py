"""The report of `qpal compare`: overlay, error by regime, frequency responses, residual tests and the verdict."""

import math
from collections.abc import Iterator

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import capital, display_quantity, number, percent
from sysid.diagnosis.residuals import ResidualTests
from sysid.joint.values import WORDS as JOINT_WORDS
from sysid.joint.values import JointValue
from sysid.plots.residual_tests import residuals_figure
from sysid.report.page import Grid, Page, Picture, Section
from sysid.report.sections import NOT_KNOWN, decimals, fixed_point, value_cells
from twin.compare.alignment import Alignment
from twin.compare.comparison import LOG, MODEL, TWIN, Comparison
from twin.compare.departure import DEFINITIONS
from twin.compare.intervals import Value
from twin.compare.joints import EFFECTS, Pair
from twin.compare.structures import CAUSES, STRUCTURES
from twin.compare.verdict import Change, Share, Verdict
from twin.follow import VISIBLE
from twin.report import compare_figures as figures
from twin.report import leg

UNKNOWN = "not determined by this record"
_SMALLEST = f"{math.degrees(VISIBLE):g} deg"
WORDS = {
    **{"end_low": "lower end stop", "end_high": "upper end stop", "slope": "sensor slope", "zero": "zero"},
    **{"spring_time": "time constant of the spring", "spring_damping": "its damping ratio"},
    **{"cable_stretch": "stretch", "cable_way": "way over which it stretches"},
    **{"creep_end": "creep in the end", "creep_time": "its time constant"},
    **{"wave_sine": "sine of the error", "wave_cosine": "cosine of the error"},
    **{"wave_turns": "waves a turn of the joint", "give": "give per volt", "give_time": "its time constant"},
}


def page(result: Comparison, file: str) -> Page:
    """The report on one comparison."""
    return Page(
        title=f"The {result.joint} beside {result.label}",
        subtitle=f"{file}, {len(result.y)} samples, Ts {result.Ts:g} s",
        verdict=sentences(result, file),
        sections=list(_sections(result)),
        made_with=versions(),
    )


def _sections(result: Comparison) -> Iterator[Section]:
    """The sections of the page, of which the twin alone has all."""
    overlay = Picture.of("overlay", figures.overlay_figure(result), _overlay_caption(result))
    regimes = Picture.of("regimes", figures.regimes_figure(result), _regime_caption(result))
    yield Section("Record", pictures=[overlay, regimes, _leg(result)], tables=[regime_table(result)])
    if result.verdict is not None:
        tables = [effect_table(result.verdict), *_change_tables(result.verdict)]
        effects = Picture("effects", style.png(figures.effects(result.verdict)), _effect_caption(result.verdict))
        yield Section("Physical effects", [_METHOD], tables=tables, pictures=[effects])
    if result.alignment is not None:
        yield Section("Alignment", result.alignment.sentences(), tables=[alignment_table(result.alignment)])
    if result.pairs:
        yield Section("The actuated joint, fitted to both", [_PAIRS], tables=[pair_table(result)])
    spectra = Picture.of("spectra", figures.spectra_figure(result), _spectra_caption(result))
    yield Section("Frequency response", pictures=[spectra])
    if result.tests is not None:
        picture = Picture.of("residuals", residuals_figure(result.tests), _tests_caption(result.tests))
        yield Section("Residual tests", pictures=[picture])


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


def sentences(result: Comparison, file: str) -> list[str]:
    """The verdict in words, and the next command."""
    if result.kind == LOG:
        return _of_repeat(result)
    worst = max(result.regimes, key=lambda regime: regime.of_error)
    label = capital(result.label) if result.kind == TWIN else result.label  # of a model: the name of its file
    first = (
        f"{label} follows the log with an error of {_deg(result.rms)} RMS (fit {percent(result.fit)}, "
        f"noise of the log {_deg(result.noise)}); {100 * worst.of_error:.0f} % of the squared error is in the regime "
        f"'{worst.name}', which is {100 * worst.share:.0f} % of the record."
    )
    if result.kind == MODEL:
        return [first]
    texts = [first]
    alignment = result.alignment
    if alignment is not None and alignment.turned:
        texts.append(alignment.sentences()[0])
    if result.verdict is not None:
        texts += verdict_sentences(result.verdict, result.joint, file)
    return texts


def verdict_sentences(verdict: Verdict, joint: str, file: str) -> list[str]:
    """What explains the departure, what acts alike, what is left, and what to do next."""
    if verdict.chance and verdict.known:
        return [
            f"No departure that matters: over the first {verdict.seconds:g} s the error is {_deg(verdict.rms)} RMS "
            f"with nothing moved, noise makes {_deg(verdict.noise)} of it, and no cause improves the fit by more than "
            f"chance and {_SMALLEST}."
        ]
    if not verdict.known:
        return _of_unknown(verdict, joint)
    texts = [_of_share(share, k, verdict) for k, share in enumerate(verdict.named)]
    first = CAUSES[verdict.named[0].effect]
    for name in verdict.alike:
        rival = CAUSES[name]
        share = next(candidate.share for candidate in verdict.alone if candidate.effect == name)
        texts.append(
            f"On this record {first.words} and {rival.words} act alike: {rival.words} alone would explain "
            f"{_percent(share)}. To tell them apart, record {rival.why}: qpal simulate --joint {joint} {rival.record}."
        )
    texts.append(_next(verdict, joint, file))
    return texts


def _of_unknown(verdict: Verdict, joint: str) -> list[str]:
    """That no cause explains the departure, what came nearest, what it leaves, and the record that would tell more."""
    texts = [
        f"The leg does something that the twin does not have: of the departure of {_deg(verdict.rms)} RMS no cause "
        "that was tried explains the whole, so none is named."
    ]
    left = verdict.left
    best = CAUSES[(verdict.named or verdict.alone)[-1 if verdict.named else 0].effect]
    following = (
        f"Next: play on the leg {best.why}, the input of: qpal simulate --joint {joint} {best.record}. Compare that "
        "log too."
    )
    if not verdict.named:
        none = f"No cause lowers the error by more than chance and {_SMALLEST}, and {_deg(left.rms)} RMS is no noise."
        return [*texts, none, following]
    words = " and ".join(CAUSES[share.effect].words for share in verdict.named)
    reasons = [f"{_deg(left.rms)} RMS is left that is no noise"] if left.structured else []
    if left.uneven:
        reasons.append(f"the values that suit the record differ between {', and '.join(left.uneven)} parts of it")
    texts.append(f"{capital(words)} came nearest ({_percent(verdict.explained)}), but {'; '.join(reasons)}.")
    return [*texts, following]


def _of_share(share: Share, k: int, verdict: Verdict) -> str:
    effect = CAUSES[share.effect]
    values = "; ".join(_of_change(change) for change in share.changes)
    if k == 0:
        return (
            f"{capital(effect.words)} explains {_percent(share.share)} of the departure of {_deg(verdict.rms)} RMS: "
            f"{values}."
        )
    gain = share.share - verdict.named[k - 1].share
    return f"Beside it, {effect.words} explains a further {_percent(gain)}: {values}."


def _of_change(change: Change) -> str:
    """A value that an effect moves: as the log has it, and as the twin has it."""
    unit = display_quantity("", change.log.unit)
    twin, log = (number(unit.factor * value, 3) for value in (change.twin, change.log.value))
    span = interval(change.log, unit.factor, "")
    doubt = f"95 %: {span}" if span else UNKNOWN
    name = WORDS.get(change.name, change.name)
    return f"{name} {log}{' ' + unit.unit if unit.unit else ''} ({doubt}) where the twin has {twin}"


def interval(value: Value | JointValue, factor: float, unknown: str, digits: int = 3) -> str:
    """The interval in display units; `unknown` for a value that the record does not determine."""
    if value.low is None or value.high is None:
        return unknown
    return f"{number(factor * value.low, digits)} to {number(factor * value.high, digits)}"


def _next(verdict: Verdict, joint: str, file: str) -> str:
    free = [name for share in verdict.named for name in CAUSES[share.effect].free_of(joint)]
    outside = [CAUSES[share.effect] for share in verdict.named if share.effect in STRUCTURES]
    if outside:
        cause = outside[0]
        return (
            f"The twin has no such part. Next: play on the leg {cause.why}, and compare that log too; the input is "
            f"that of: qpal simulate --joint {joint} {cause.record}"
        )
    if not free:
        return f"Next: qpal compare {file} --joint {joint} --align gear,offset, or correct the sensor's scale."
    return f"Next: qpal calibrate {file} --joint {joint} --free {','.join(dict.fromkeys(free))}"


def _of_repeat(result: Comparison) -> list[str]:
    """What two logs of the same input say of each other."""
    repeat = result.repeat
    assert repeat is not None
    offset, drift = repeat.offset, repeat.drift
    grows = "no drift beyond chance"
    if repeat.drifts:
        grows = f"a drift of {_deg(60 * drift[0])} a minute (95 %: {_deg(60 * drift[1])} to {_deg(60 * drift[2])})"
    return [
        f"Two logs under one input differ by {_deg(result.rms)} RMS over {repeat.samples} samples: an offset of "
        f"{_deg(offset[0])} (95 %: {_deg(offset[1])} to {_deg(offset[2])}), {grows}, and a spread of "
        f"{_deg(repeat.spread)} about it.",
        f"Noise of both logs alone makes a spread of {_deg(repeat.by_noise)}: "
        + (
            "the experiment repeats within noise."
            if repeat.spread <= 1.2 * repeat.by_noise
            else "the rest is what a model of this joint cannot predict."
        ),
    ]


def tables(result: Comparison) -> list[Grid]:
    """The tables of the terminal."""
    grids = [regime_table(result)]
    if result.alignment is not None:
        grids.append(alignment_table(result.alignment))
    if result.verdict is not None:
        grids.append(effect_table(result.verdict))
    if result.pairs:
        grids.append(pair_table(result))
    return grids


def regime_table(result: Comparison) -> Grid:
    """Share of samples, RMS error and share of the squared error of every regime, with its definition."""
    rows = [
        (
            regime.name,
            _percent(regime.share),
            number(display_quantity("", "rad").factor * regime.rms, 3) if regime.share else "–",
            _percent(regime.of_error),
            DEFINITIONS[regime.name],
        )
        for regime in result.regimes
    ]
    headings = ("regime", "share of the record", "RMS of the error [deg]", "share of the error", "definition")
    return Grid(headings, rows, last_text=True)


def alignment_table(alignment: Alignment) -> Grid:
    """Delay, gear and offset with their intervals."""
    rows = [
        (name, *_aligned(value, factor), unit)
        for name, value, factor, unit in (
            ("delay of the log", alignment.delay, 1e3, "ms"),
            ("gear (slope)", alignment.gear, 1.0, ""),
            ("offset (angle zero)", alignment.offset, display_quantity("", "rad").factor, "deg"),
        )
    ]
    note = (
        "On legs that differ from the twin in nine values at once these intervals held the true value 17 times of 21."
    )
    return Grid(("log over twin", "value", "95 % interval", "unit"), rows, last_text=True, note=note)


def _aligned(value: Value, factor: float) -> tuple[str, str]:
    """A value and its interval, with the digits that the interval means."""
    if value.low is None or value.high is None:
        return number(factor * value.value, 4), NOT_KNOWN
    digits = decimals(factor * (value.high - value.low))
    shown, low, high = (fixed_point(factor * x, digits) for x in (value.value, value.low, value.high))
    return shown, f"{low} to {high}"


def effect_table(verdict: Verdict) -> Grid:
    """Every effect moved alone, best first."""
    rows = [
        (
            CAUSES[share.effect].words,
            "–" if verdict.chance else _percent(share.share),
            number(display_quantity("", "rad").factor * share.rms, 3),
        )
        for share in verdict.alone
    ]
    return Grid(("effect, moved alone", "departure that vanishes", "RMS left [deg]"), rows)


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
                    number(unit.factor * change.log.value, 4),
                    interval(change.log, unit.factor, UNKNOWN),
                    unit.unit,
                )
            )
    headings = ("effect", "value", "twin", "log", "95 % interval", "unit")
    return [Grid(headings, rows, text_columns=2, last_text=True)] if rows else []


def pair_table(result: Comparison) -> Grid:
    """Values of the actuated joint on both sides."""
    rows = [pair_row(pair) for pair in result.pairs]
    headings = ("value", "effect", "log", "95 % interval", "twin", "95 % interval", "unit", "differ")
    return Grid(headings, rows, text_columns=2, last_text=True)


def pair_row(pair: Pair) -> tuple[str, ...]:
    """A value of both sides, and whether they differ."""
    (log, span, unit), (other, other_span, _) = value_cells(pair.log), value_cells(pair.other)
    differ = {True: "yes", False: "no", None: "cannot tell"}[pair.apart]
    name = JOINT_WORDS.get(pair.name, pair.name)
    return (name, CAUSES[EFFECTS[pair.name]].words, log, span, other, other_span, unit, differ)


def _overlay_caption(result: Comparison) -> str:
    return (
        f"Top: the log and {result.label} under the same input. Middle: log less {result.label}. Bottom: the input. "
        f"The error is {_deg(result.rms)} RMS; noise of the log alone is {_deg(result.noise)}, the grey band of twice "
        "that."
    )


def _regime_caption(result: Comparison) -> str:
    worst = max(result.regimes, key=lambda regime: regime.rms)
    return (
        f"RMS of the error in each regime of the log, and the share of the squared error that each makes. The error is "
        f"largest in the regime '{worst.name}', {_deg(worst.rms)} RMS."
    )


def _effect_caption(verdict: Verdict) -> str:
    """What the bars of the effects show, and which is longest."""
    if verdict.chance:
        return (
            "RMS of the error that is left when one effect alone is moved to fit the log, and with nothing moved "
            "(dashed), where an effect stays that makes nothing better. No effect makes it smaller by more than chance "
            "does."
        )
    best, longest = verdict.alone[0], max(verdict.alone, key=lambda share: share.share)
    text = (
        "Share of the departure that vanishes when one cause alone is moved to fit the log. Filled: those that the "
        f"verdict {'names' if verdict.known else 'finds nearest, and does not name'}. The best alone is "
        f"{CAUSES[best.effect].words}, {_percent(best.share)}"
    )
    if _percent(longest.share) == _percent(best.share):
        return f"{text}."
    return (
        f"{text}; {CAUSES[longest.effect].words}, {_percent(longest.share)}, stands behind it because it moves more "
        "values (BIC)."
    )


def _spectra_caption(result: Comparison) -> str:
    return (
        f"Frequency response from voltage to angle of the log and of {result.label}, both by "
        f"{result.spectra[0].method}, with 95 % bands. Where the bands do not overlap, the two differ in their linear "
        "part; a joint with friction and stops has wide bands, because its nonlinearity acts like noise."
    )


def _tests_caption(tests: ResidualTests) -> str:
    return (
        f"Correlations of the error with itself ({tests.whiteness_outside} of {len(tests.lags) - 1} lags outside) and "
        f"with the input ({tests.independence_outside} of {len(tests.cross_lags)} outside). {tests.rule}"
    )


def _deg(angle: float) -> str:
    return f"{number(display_quantity('', 'rad').factor * angle, 3)} deg"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


__all__ = ["TWIN", "effect_table", "page", "pair_table", "sentences", "tables", "verdict_sentences"]
