"""The report of `qpal identify`: one record, one model."""

from twin.evaluation import Evaluation
from twin.identification import Identification
from twin.record import Record
from twin.report import figures, sections, style
from twin.report.page import Grid, Page, Picture, Section
from twin.report.units import Quantity, number, percent, poles
from twin.versions import versions


def page(result: Identification) -> Page:
    """The report on a fit to a record."""
    record, e = result.record, result.evaluation
    return Page(
        title=f"Identification of {record.path.name}",
        subtitle=(
            f"{_column(record.input)} to {_column(record.output)}, {record.data.N} samples, Ts {record.data.Ts:g} s"
        ),
        verdict=_verdict(e),
        sections=[_data(record, e), _output(e), _model(e), _residuals(e)],
        made_with=versions(),
    )


def terminal_tables(result: Identification) -> list[Grid]:
    """What the command prints: criteria and poles."""
    return [sections.criteria_grid(result.evaluation), sections.pole_grid(result.evaluation)]


def terminal_sentences(result: Identification) -> list[str]:
    """What the command says under its tables."""
    e = result.evaluation
    notes = [f"Note: {note}." for note in (*result.record.notes, *e.notes)]
    return [sections.tests_in_words(e), sections.search_sentence(e), *notes]


def _column(name: str) -> str:
    return f"column {name}" if name.isdigit() else name


def _verdict(e: Evaluation) -> list[str]:
    stable = "stable" if e.stable else "not stable"
    first = (
        f"A {sections.setting_in_words(e)} model runs free over the validation part with a fit of "
        f"{percent(e.validation_fit)} ({percent(e.estimation_fit)} on the part that it was fitted to). "
        f"It is {stable}: poles {poles(e.fit.poles)}. {sections.tests_in_words(e)}"
    )
    return [first, sections.search_sentence(e), *(f"Note: {note}." for note in e.notes)]


def _data(record: Record, e: Evaluation) -> Section:
    n = e.estimation.N
    u, y = sections.signals(e)
    split = Picture(
        "data",
        style.png(figures.preprocessed(e.estimation, e.validation)),
        f"The record as it was used: the first {n} samples for estimation, the other {e.validation.N} for validation.",
    )
    removed = (
        f"Removed before the fit: {_offset(u, e.estimation.u_offset[0])} from the input and "
        f"{_offset(y, e.estimation.y_offset[0])} from the output (means over the whole record). "
        if e.estimation.u_offset[0] or e.estimation.y_offset[0]
        else "Nothing was removed from the data. "
    )
    notes = "".join(f"{note[0].upper()}{note[1:]}. " for note in record.notes)
    return Section("Data", [f"Read from {record.path}. {notes}{removed}"], pictures=[split])


def _offset(quantity: Quantity, value: float) -> str:
    return f"{number(value * quantity.factor)} {quantity.unit}".rstrip()


def _output(e: Evaluation) -> Section:
    run = Picture(
        "free-run",
        style.png(figures.free_run(e)),
        f"Measured output and the model's free run: only the input is used, and the first {e.fit.n_init} outputs of "
        "each part for the initial state; these are not scored.",
    )
    return Section("Model output", pictures=[run, sections.picture_of_close_ups("close-up", e)])


def _model(e: Evaluation) -> Section:
    pictures = [
        sections.picture_of_poles("pole-zero", e),
        sections.picture_of_step("step-response", e),
        sections.picture_of_maps("static-maps", e),
    ]
    return Section(
        "Model",
        tables=[sections.criteria_grid(e), sections.pole_grid(e)],
        pictures=sections.only(pictures),
        details=[sections.parameter_grid(e)],
    )


def _residuals(e: Evaluation) -> Section:
    picture = sections.picture_of_residuals("residuals", e)
    return Section("Residual tests", [] if picture else [sections.tests_in_words(e)], pictures=sections.only([picture]))
