"""The verdict of `qpal compare` in words: what explains the departure, what the log does not show, what comes next."""

import math
from collections.abc import Sequence

from sysid.base.quantities import capital, display_quantity, estimate, number, percent
from sysid.joint.values import JointValue
from twin.compare.comparison import LOG, MODEL, TWIN, Comparison
from twin.compare.departure import Repeat
from twin.compare.effects import Effect
from twin.compare.intervals import Value
from twin.compare.structures import CAUSES, STRUCTURES
from twin.compare.verdict import Change, Share, Verdict
from twin.follow import VISIBLE

UNKNOWN = "not determined by this record"
SMALLEST = f"{math.degrees(VISIBLE):g} deg"
WORDS = {
    **{"end_low": "lower end stop", "end_high": "upper end stop", "slope": "sensor slope", "zero": "zero"},
    **{row.name: row.words for structure in STRUCTURES.values() for row in structure.rows},
}
_OUTSIDE = {name for structure in STRUCTURES.values() for name in structure.knobs}


def sentences(result: Comparison, file: str) -> list[str]:
    """The verdict in words, and the next command."""
    if result.kind == LOG:
        return [*_of_repeat(result), *_outlier_sentences(result, file)]
    worst, bad_readings = max(result.regimes, key=lambda regime: regime.of_error), _outlier_sentences(result, file)
    label = capital(result.label) if result.kind == TWIN else result.label  # of a model: the name of its file
    first = (
        f"{label} follows the log with an error of {deg(result.rms)} RMS (fit {percent(result.fit)}, "
        f"noise of the log {deg(result.noise)}); {100 * worst.of_error:.0f} % of the squared error is in the regime "
        f"'{worst.name}', which is {100 * worst.share:.0f} % of the record."
    )
    if result.kind == MODEL:
        return [first, *bad_readings]
    texts = [first, *bad_readings]
    alignment = result.alignment
    if alignment is not None and alignment.turned:
        texts.append(alignment.sentences()[0])
    hidden = sum(outlier.of_error for outlier in result.outliers) > 0.5  # most of the departure is bad readings
    if result.verdict is not None and (result.verdict.known or not hidden):
        texts += verdict_sentences(result.verdict, result.joint, file)
        if result.verdict.chance and result.verdict.known and result.unseen:
            texts.append(f"The log does not show {_list(result.unseen)}, and tells nothing about that.")
    return texts


def _outlier_sentences(result: Comparison, file: str) -> list[str]:
    """The readings that no joint makes, and what to do about them; none without."""
    if not result.outliers:
        return []
    largest, count = max(result.outliers, key=lambda outlier: abs(outlier.size)), len(result.outliers)
    subject = "One sample," if count == 1 else f"{count} samples are far off; the farthest,"
    where = "" if result.kind == LOG else f": qpal compare {file} --joint {result.joint}"
    them = "the log that has them" if result.kind == LOG else "the log"
    return [
        f"{subject} at {largest.time:.4g} s, is {deg(abs(largest.size))} off its neighbours (noise of the log "
        f"{deg(result.noise)}): no joint goes there and back so fast.",
        f"Next: put the mean of both neighbours in place of {'each' if count > 1 else 'it'} in {them}, and compare "
        f"again{where}",
    ]


def _list(texts: Sequence[str]) -> str:
    return ", ".join(texts[:-1]) + (" and " if len(texts) > 1 else "") + texts[-1]


def verdict_sentences(verdict: Verdict, joint: str, file: str) -> list[str]:
    """What explains the departure, what acts alike, what is left, and what to do next."""
    if verdict.chance and verdict.known:
        return [
            f"No departure that matters: over the first {verdict.seconds:g} s the error is {deg(verdict.rms)} RMS "
            f"with nothing moved, noise makes {deg(verdict.noise)} of it, and no cause improves the fit by more than "
            f"chance and {SMALLEST}."
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
            f"{share_text(share)}. To tell them apart, {_to_play(rival, joint)}"
        )
    texts.append(_next(verdict, joint, file))
    return texts


def _of_unknown(verdict: Verdict, joint: str) -> list[str]:
    """That no cause explains the departure, what came nearest, what it leaves, and the record that would tell more."""
    texts = [
        f"The leg does something that the twin does not have: of the departure of {deg(verdict.rms)} RMS no cause "
        "that was tried explains the whole, so none is named."
    ]
    left = verdict.left
    best = CAUSES[(verdict.named or verdict.alone)[-1 if verdict.named else 0].effect]
    following = f"Next: {_to_play(best, joint)}"
    if not verdict.named:
        none = f"No cause lowers the error by more than chance and {SMALLEST}, and {deg(left.rms)} RMS is no noise."
        return [*texts, none, following]
    words = " and ".join(CAUSES[share.effect].words for share in verdict.named)
    reasons = [f"{deg(left.rms)} RMS is left that is no noise"] if left.structured else []
    if left.uneven:
        reasons.append(_list([_UNEVEN[name] for name in left.uneven]))
    texts.append(f"{capital(words)} came nearest ({share_text(verdict.explained)}), but {'; '.join(reasons)}.")
    return [*texts, following]


_UNEVEN = {  # the splits of `twin.compare.remainder`
    "earlier and later": "the first half of the record asks for other values than the second",
    "upward and downward": "upward motion asks for other values than downward motion",
    "low and high voltages": "low voltages ask for other values than high ones",
    "low and high angles": "the lower half of the angles asks for other values than the upper half",
}


def _to_play(cause: Effect, joint: str) -> str:
    """The record that shows this cause, to be made on the leg, and the command that gives its input as a file."""
    return (
        f"play on the leg {cause.why}, and compare that log too; the input, as input.csv: "
        f"qpal simulate --joint {joint} {cause.record} --log input.csv"
    )


def _of_share(share: Share, k: int, verdict: Verdict) -> str:
    effect = CAUSES[share.effect]
    values = "; ".join(_of_change(change) for change in share.changes)
    if k == 0:
        return (
            f"{capital(effect.words)} explains {share_text(share.share)} of the departure of {deg(verdict.rms)} RMS: "
            f"{values}."
        )
    gain = share.share - verdict.named[k - 1].share
    return f"Beside it, {effect.words} explains a further {share_text(gain)}: {values}."


def _of_change(change: Change) -> str:
    """A value that an effect moves: as the log has it, and as the twin has it, where it has one."""
    unit = display_quantity("", change.log.unit)
    twin = number(unit.factor * change.twin, 3)
    log, span = shown(change.log, unit.factor, "")
    doubt = f"95 %: {span}" if span else UNKNOWN
    name = WORDS.get(change.name, change.name)
    beside = "" if change.name in _OUTSIDE else f" where the twin has {twin}"
    return f"{name} {log}{' ' + unit.unit if unit.unit else ''} ({doubt}){beside}"


def shown(value: Value | JointValue, factor: float, unknown: str) -> tuple[str, str]:
    """A value and its interval in display units; `unknown` where the record does not determine it."""
    if value.low is None or value.high is None:
        return number(factor * value.value), unknown
    found, low, high = estimate(*(factor * x for x in (value.value, value.low, value.high)))
    return found, f"{low} to {high}"


def _next(verdict: Verdict, joint: str, file: str) -> str:
    free = [name for share in verdict.named for name in CAUSES[share.effect].free_of(joint)]
    outside = [CAUSES[share.effect] for share in verdict.named if share.effect in STRUCTURES]
    if outside:
        return f"The twin has no such part. Next: {_to_play(outside[0], joint)}"
    if not free:
        return f"Next: correct the sensor's scale, or fit it: qpal compare {file} --joint {joint} --align gear,offset"
    return f"Next: qpal calibrate {file} --joint {joint} --free {','.join(dict.fromkeys(free))}"


def _of_repeat(result: Comparison) -> list[str]:
    """What two logs of the same input say of each other."""
    repeat = result.repeat
    assert repeat is not None
    offset, drift = repeat.offset, repeat.drift
    grows = "no drift beyond chance"
    if repeat.drifts:
        grows = f"a drift of {deg(60 * drift[0])} a minute (95 %: {deg(60 * drift[1])} to {deg(60 * drift[2])})"
    return [
        f"Two logs under one input differ by {deg(result.rms)} RMS over {repeat.samples} samples: an offset of "
        f"{deg(offset[0])} (95 %: {deg(offset[1])} to {deg(offset[2])}), {grows}, and a spread of "
        f"{deg(repeat.spread)} about it.",
        f"Noise of both logs alone makes a spread of {deg(repeat.by_noise)}: "
        + (
            "the experiment repeats within noise."
            if repeats(repeat)
            else "the rest is what a model of this joint cannot predict."
        ),
    ]


def repeats(repeat: Repeat) -> bool:
    """Whether two logs of one input differ, about their trend, by no more than noise: a spread near to it counts."""
    return repeat.spread <= 1.2 * repeat.by_noise


def deg(angle: float) -> str:
    return f"{number(display_quantity('', 'rad').factor * angle, 3)} deg"


def share_text(share: float) -> str:
    """In per cent; 100 only for all of it."""
    return f"{100 * min(share, 0.999):.1f} %" if 0.995 <= share < 1.0 else f"{100 * share:.0f} %"
