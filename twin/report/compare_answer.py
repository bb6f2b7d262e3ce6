"""The first screen of `qpal compare`: how far the other side is from the log, and whether that is explained."""

from sysid.base.quantities import capital, display_quantity, percent
from sysid.diagnosis.residuals import UNTESTED
from sysid.diagnosis.worth import worth
from sysid.report.answer import GOOD, POOR, USABLE, Answer, Word
from sysid.report.page import Grid, Picture
from sysid.report.sections import NOT_KNOWN
from sysid.report.verdict import left_in_words
from twin.compare.alignment import Alignment
from twin.compare.comparison import LOG, MODEL, Comparison
from twin.compare.departure import Repeat
from twin.compare.intervals import Value
from twin.compare.structures import CAUSES
from twin.compare.verdict import Change, Verdict
from twin.report.compare_words import SMALLEST, WORDS, deg, repeats, share_text, shown


def answer(result: Comparison, picture: Picture, sentences: list[str]) -> Answer:
    """The first screen; of the `sentences` of the verdict the first that names a next step has it."""
    steps = [text[text.index("Next:") :] for text in sentences if "Next:" in text]
    return Answer(
        deg(result.rms),
        f"RMS from the log to {result.label}; noise of the log {deg(result.noise)}, fit {percent(result.fit)}",
        word(result),
        sentence(result),
        picture,
        values=values(result),
        next=steps[0] if steps else "",
    )


def word(result: Comparison) -> Word:
    """Of a saved model as `worth` says; else good if nothing but noise departs, poor if nothing explains it.

    Never good with bad readings or a wrong sign.
    """
    if result.kind == LOG:
        found = GOOD if result.repeat is not None and repeats(result.repeat) else USABLE
    elif result.kind == MODEL or result.verdict is None:
        found = worth(result.fit, result.tests)
    else:
        found = POOR if not result.verdict.known else GOOD if result.verdict.chance else USABLE
    return USABLE if found == GOOD and (result.outliers or _turned(result)) else found


def _turned(result: Comparison) -> bool:
    return result.alignment is not None and bool(result.alignment.turned)


def sentence(result: Comparison) -> str:
    """Why the word."""
    if result.outliers:
        return f"{len(result.outliers)} of {len(result.y)} samples lie where no joint goes."
    if result.alignment is not None and _turned(result):
        return result.alignment.sentences()[0]
    if result.kind == LOG:
        return "Noise alone makes them differ." if word(result) == GOOD else "They differ by more than noise."
    if result.verdict is None:
        return f"{capital(left_in_words(result.tests, [f'{UNTESTED}the log is too short']))}."
    return _of_twin(result.verdict)


def _of_twin(verdict: Verdict) -> str:
    if not verdict.known:
        return "The leg does something that the twin does not have: no cause that was tried explains the whole."
    if verdict.chance:
        return f"No departure that matters: no cause improves the fit by more than chance and {SMALLEST}."
    names = " and ".join(CAUSES[share.effect].words for share in verdict.named)
    return (
        f"{capital(names)} explain{'s' * (len(verdict.named) == 1)} {share_text(verdict.explained)} of the departure."
    )


def values(result: Comparison) -> Grid:
    """The values that explain the departure, else those of the alignment or of the repeat."""
    if result.verdict is not None and not result.verdict.chance:
        rows = [_row(change) for share in result.verdict.named for change in share.changes]
    elif result.alignment is not None:
        rows = alignment_rows(result.alignment)
    else:
        rows = [] if result.repeat is None else _of_repeat(result.repeat)
    return Grid(("", "value", "95 % interval", "unit"), rows, last_text=True)


def alignment_rows(alignment: Alignment) -> list[tuple[str, ...]]:
    """Delay, gear and offset with their intervals."""
    return [
        (name, *shown(value, factor, NOT_KNOWN), unit)
        for name, value, factor, unit in (
            ("delay of the log", alignment.delay, 1e3, "ms"),
            ("gear (slope)", alignment.gear, 1.0, ""),
            ("offset (angle zero)", alignment.offset, display_quantity("", "rad").factor, "deg"),
        )
    ]


def _row(change: Change) -> tuple[str, ...]:
    unit = display_quantity("", change.log.unit)
    return WORDS.get(change.name, change.name), *shown(change.log, unit.factor, NOT_KNOWN), unit.unit


def _of_repeat(repeat: Repeat) -> list[tuple[str, ...]]:
    angle, offset, drift = (
        display_quantity("", "rad").factor,
        Value("", *repeat.offset, "rad"),
        Value("", *repeat.drift, "rad/s"),
    )
    return [
        ("offset", *shown(offset, angle, NOT_KNOWN), "deg"),
        ("drift", *shown(drift, 60.0 * angle, NOT_KNOWN), "deg/min"),
    ]
