"""The report of `qpal identify`: one record, one model."""

import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.base.files import versions
from sysid.base.quantities import Quantity, capital, number, percent
from sysid.estimation.result import Fit
from sysid.export import closed_form
from sysid.report import figures, sections, verdict
from sysid.report.identify_answer import answer
from sysid.report.page import Grid, Listing, Page, Section
from sysid.report.verdict import shapes_in_words, tests_in_words
from sysid.selection.table import Selection
from sysid.structures import TABLE
from sysid.workflow.identification import Identification
from sysid.workflow.plan import Plan
from sysid.workflow.record import Record
from sysid.workflow.results import Evaluation
from sysid.workflow.saved import Exports

RANKED = 12  # rows of a structure search that are shown
WARNINGS = 3  # of the advice, in the terminal
_WEIGHT = {"warning": 0, "note": 1, "fine": 2}


def page(result: Identification, exports: Exports, model: str = "") -> Page:
    """The report on a fit to a record; `exports` lists the model files, `model` is the path of the saved model."""
    record, e, first = result.record, result.evaluation, answer(result, model)
    first = replace(first, sentence=_with_commands(first.sentence, record), next=_with_commands(first.next, record))
    return Page(
        title=f"Identification of {' and '.join(Path(path).name for path in record.paths)}",
        subtitle=(
            f"{_column(record.input)} to {_column(record.output)}, {record.data.N} samples, Ts {record.data.Ts:g} s"
        ),
        verdict=_verdict(result),
        sections=[
            _data(record, e, result.plan),
            _advice(result),
            *_search(result),
            _output(e),
            _model(result),
            *_spectra(e),
            _residuals(e),
            _files(e, exports),
            Section("Search", [sections.search_sentence(e)]),
        ],
        made_with=versions(),
        answer=first,
    )


def terminal_tables(result: Identification) -> list[Grid]:
    """The tables that the command prints below the answer: the ranking of a search, criteria and poles."""
    e = result.evaluation
    ranking = [] if result.selection is None else [ranking_grid(result)]
    criteria = sections.criteria_grid(e).only("criterion", "value")
    return [*ranking, criteria, *sections.only([sections.pole_grid(e), sections.values_grid(e)])]


def terminal_sentences(result: Identification) -> list[str]:
    """The sentences that the command prints below its tables."""
    e = result.evaluation
    selection = [] if result.selection is None else [_search_result(result.selection)]
    advice = [f"Warning: {a}." for a in result.advice if a.severity == "warning"][:WARNINGS]
    search_notes = () if result.selection is None else result.selection.notes
    notes = [f"Note: {note}." for note in (*result.record.notes, *search_notes, *_notes(e))]
    sentences = [*selection, *_part_sentences(e), *filter(None, [sections.undetermined_in_words(e)])]
    last = [*shapes_in_words(e), tests_in_words(e), *advice, *notes, *sections.unfinished_search(e)]
    return [_with_commands(text, result.record) for text in (*sentences, *last)]


def _notes(e: Evaluation) -> list[str]:
    """The notes, but what the sentence on the search says."""
    return [note for note in e.notes if e.fit.stop.reason not in note]


def _with_commands(text: str, record: Record) -> str:
    """The text with this record's file, and the options that read it, in the commands that it names."""
    files = [str(file) for file in record.paths]

    def with_files(found: re.Match) -> str:
        own = files[:1] if found[1].startswith("qpal design") else files  # of one log
        return f"{found[1]} {shlex.join([*own, *record.options])}"

    return re.sub(r"\b(qpal \w+(?: --\w+ [\w,]+)*) FILE\b", with_files, text)


def _part_sentences(e: Evaluation) -> list[str]:
    """The parts of a joint."""
    return [e.joint_fit.sentence()] if e.joint_fit is not None and not verdict.no_joint(e) else []


def ranking_grid(result: Identification) -> Grid:
    """The best candidates of a structure search; the chosen one and those equal to the best are marked."""
    assert result.selection is not None
    rows = []
    leaders = {id(row) for row in result.selection.best_of_each}
    for k, row in enumerate(result.selection.rows, start=1):
        c = row.candidate
        if k > RANKED and c != result.selection.chosen.candidate and id(row) not in leaders:
            continue
        maps = " / ".join(m.replace("_", " ") for m in c.maps.values()) or "–"
        chosen = c == result.selection.chosen.candidate
        mark = "chosen" if chosen else "equal" if row.equal else _short(row.why)
        fit = percent(row.fit_percent) if row.round else "–"
        rows.append((str(k) if row.round else "–", c.short, maps, fit, str(row.d) if row.round else "–", mark))
    total = sum(row.round > 0 for row in result.selection.rows)
    caption = (
        f"The best {min(RANKED, total)} of {total} candidates that were tried, the chosen one and the best of every "
        "structure: fit on unseen parts of the estimation data, d of the fit to the other parts"
    )
    return Grid(("", "structure", "maps", "fit", "d", ""), rows, caption, text_columns=3, last_text=True)


def _short(why: str) -> str:
    """The finding of a complaint, without what to do about it."""
    return why.partition(";")[0]


def _search_result(selection: Selection) -> str:
    """The result of the search, with readable names of structures and maps."""
    text = selection.sentence()
    for name in TABLE:
        text = text.replace(name, name.replace("_", "-"))
    return capital(text.replace("_", " "))


def _search(result: Identification) -> list[Section]:
    """What a structure search tried and chose; nothing without a search."""
    if result.selection is None:
        return []
    method = (
        "Every candidate was fitted to one part of the estimation data and simulated in free run on the other part, "
        "and vice versa; the parts are interleaved blocks where halves would not show the same levels; d is the "
        "effective number of parameters there, and the last fit, to all estimation data, may adapt more. Candidates "
        "marked equal do not differ significantly from the best (paired t-test at 95 %); the smallest of them is "
        "chosen. The validation data were not used. The search took "
        f"{result.selection.seconds:.0f} s."
    )
    notes = [sections.sentence(note) for note in result.selection.notes]
    return [Section("Structure search", [_search_result(result.selection), method, *notes], [ranking_grid(result)])]


def _advice(result: Identification) -> Section:
    advice = sorted(result.advice, key=lambda a: _WEIGHT[a.severity])
    rows = [(a.severity, a.topic, a.sentence.replace("^2", "²"), a.action or "–") for a in advice]
    return Section(
        "Advice",
        ["The diagnosis of the record before any model."],
        [Grid(("", "topic", "finding", "what to do"), rows, text_columns=4)],
    )


def _files(e: Evaluation, exports: Exports) -> Section:
    rows = [(name, meaning) for name, meaning in exports.files]
    tables = [Grid(("file", "what it is"), rows, text_columns=2)] if rows else []
    listings = []
    if isinstance(e.fit, Fit) and not exports.notes:
        listings = [Listing("The model in closed form", closed_form.text(e.fit))]
    return Section("Model files", [sections.sentence(note) for note in exports.notes], tables, listings=listings)


def _column(name: str) -> str:
    return f"column {name}" if name.isdigit() else name


def _verdict(result: Identification) -> list[str]:
    """The result in words, with all that is to be known of it."""
    selection = [] if result.selection is None else [_search_result(result.selection)]
    notes = [f"Note: {note}." for note in _notes(result.evaluation)]
    return [_with_commands(text, result.record) for text in (*verdict.first(result), *selection, *notes)]


def _data(record: Record, e: Evaluation, plan: Plan) -> Section:
    """The record, what was read and removed, and its figure."""
    u, y = figures.signals(e)
    removed_in_words = plan.in_words()
    removal = (
        f"Removed before the fit: {_offset(u, e.estimation.u_offset)} from the input and "
        f"{_offset(y, e.estimation.y_offset)} from the output ({removed_in_words}). "
        if e.estimation.u_offset.any() or e.estimation.y_offset.any()
        else "Straight lines were removed from all signals. "
        if plan.detrend == "linear"
        else "Nothing was removed from the data. "
    )
    notes = "".join(f"{capital(note)}. " for note in record.notes)
    return Section("Data", [f"Read from {record.path}. {notes}{removal}"], pictures=figures.pictures("Data", e))


def _offset(quantity: Quantity, values: np.ndarray) -> str:
    return f"{', '.join(number(value * quantity.factor) for value in values)} {quantity.unit}".rstrip()


_PHYSICS = (
    "The parameters of an actuated joint are physical, so the table can be compared with a data sheet. Speeds apply "
    "at mid stroke. A break-away voltage includes dry friction, load and the driver's dead zone. An end stop is that "
    "of the drive: the output rests within half the backlash of it. Up means towards larger outputs. The intervals "
    "allow for coloured residuals and for what the model of a joint lacks."
)


def _output(e: Evaluation) -> Section:
    return Section("Model output", pictures=figures.pictures("Model output", e))


def _model(result: Identification) -> Section:
    """Values, poles, criteria and figures of the model."""
    e = result.evaluation
    narrow = verdict.too_narrow(e)
    return Section(
        "Model",
        [
            *filter(None, [sections.intervals_in_words(e)]),
            *_part_sentences(e),
            *([_PHYSICS] if e.values and e.physical else []),
            *(_with_commands(text, result.record) for text in filter(None, [sections.undetermined_in_words(e)])),
        ],
        tables=[
            *(replace(table, note=narrow) for table in sections.only([sections.values_grid(e), sections.pole_grid(e)])),
            sections.criteria_grid(e),
        ],
        pictures=figures.pictures("Model", e),
        details=[] if verdict.no_joint(e) else [replace(sections.parameter_grid(e), note=_deviations(e))],
    )


def _spectra(e: Evaluation) -> list[Section]:
    """The record over the frequency, beside a linear model; nothing of other models and short records."""
    pictures = figures.pictures("Spectra", e)
    return [Section("Spectra", pictures=pictures)] if pictures else []


def _deviations(e: Evaluation) -> str:
    """What is known of the deviations of parameters."""
    coloured = e.tests is not None and not e.tests.white
    words = (
        "Too small: these standard deviations take the residuals as white, and the residuals are coloured; those of "
        "poles and physical values allow for it."
        if coloured and isinstance(e.fit, Fit)
        else ""
    )
    return " ".join(filter(None, [words, verdict.too_narrow(e)]))


def _residuals(e: Evaluation) -> Section:
    pictures = figures.pictures("Residual tests", e)
    words = [] if e.tests else [tests_in_words(e)]  # else they stand in the caption
    return Section("Residual tests", [*words, *filter(None, [sections.higher_in_words(e)])], pictures=pictures)
