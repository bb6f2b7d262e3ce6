"""Results: the board of models with the overlay of their free runs, and one model or study with its figures."""

from typing import Any

from nicegui import ui

from sysid.base.errors import InputError
from sysid.base.quantities import capital
from twin.app import figures
from twin.app.entries import Model
from twin.app.page.answer import heading, mark
from twin.app.page.panel import Panel, attempt, delete_button, note, tell
from twin.app.samples import Runs

HEAD = (
    ("", "whether it is in the overlay"),
    ("model", "structure, orders and maps"),
    ("record", "the record that it was fitted to, or several; behind commas those that judge it"),
    ("estimation [%]", "fit of the free run on the estimation data"),
    ("validation [%]", "fit of the free run on the validation data: 100 % is perfect, 0 % is the mean"),
    ("d", "effective number of parameters"),
    ("time [s]", "of the fit, reading included"),
    ("", ""),
)
NUMBERS = "text-right tabular-nums"


class BoardPanel(Panel):
    """Every model of the session, the best on the validation data first."""

    title = "Models"

    def state(self) -> Any:
        return tuple(self.desk.session.models), frozenset(self.view.overlaid), self.view.detail, self.view.key

    def draw(self) -> None:
        models = self.desk.session.models
        if not models:
            note("Fitted models appear here, the best on the validation data first.")
            return
        ranking = sorted(models.items(), key=lambda item: -rank(item[1]))
        with (
            ui.element("div").classes("w-full overflow-x-auto"),
            ui.element("table").classes("qpal-table").props("data-mark=board"),
        ):
            with ui.element("tr"):
                for heading, meaning in HEAD:
                    with ui.element("th").classes("text-left"):
                        ui.label(heading).tooltip(meaning)
            for key, model in ranking:
                is_chosen = self.view.detail == ("models", key)
                with ui.element("tr").classes("bg-blue-1" if is_chosen else "").props(f"data-mark=model-{key}"):
                    self._row(key, model)
        self._overlay()

    def _row(self, key: str, model: Any) -> None:
        """Draw the cells of a model."""
        with ui.element("td"):
            ui.checkbox(value=key in self.view.overlaid, on_change=lambda event: self._tick(key, event.value)).props(
                "dense"
            )
        with ui.element("td"):
            mark(model.verdict)
            ui.button(f"{key}  {model.name.replace('_', ' ')}", on_click=lambda: self._show(key)).props(
                "flat dense no-caps align=left"
            )
            if not model.converged:
                ui.icon("warning", color="warning").tooltip("the search did not converge; give more starts")
        _cell(" + ".join((model.data, *model.further)) + "".join(f", {key}" for key in model.validation))
        _cell(_fit_cell(model.fit_estimation), NUMBERS)
        _cell("none unseen" if model.whole else _fit_cell(model.fit_validation), NUMBERS)
        _cell(str(model.d), NUMBERS)
        _cell(f"{model.seconds:.1f}", NUMBERS)
        with ui.element("td"):
            delete_button(lambda: self.desk.remove("models", key), "Delete this model")

    def _tick(self, key: str, on: bool) -> None:
        (self.view.overlaid.add if on else self.view.overlaid.discard)(key)

    def _show(self, key: str) -> None:
        self.view.detail = ("models", key)

    def _overlay(self) -> None:
        """Draw the free runs of the ticked models over the measured output."""
        models = self.desk.session.models
        record = self.view.key or next(iter(models.values())).data  # models stay where every record was deleted
        keys, other_keys = self.desk.overlaid(self.view.overlaid, record)
        runs = dict[str, Runs]()
        for key in keys:
            try:
                runs[figures.name_of(key, models[key])] = self.desk.runs(key)
            except InputError as error:
                tell(str(error))
        if other_keys:
            note(f"Not shown below, because fitted to other records than {record} alone: {', '.join(other_keys)}.")
        if not runs:
            note(f"Tick models of {record} to lay their free runs over its measured output.")
            return
        note(f"Record {record}:")
        ui.plotly(figures.overlay(runs)).classes("w-full").props("data-mark=overlay")
        note("Measured output and free runs; validation begins at the dotted line, and the legend has its fit.")


class DetailPanel(Panel):
    """What the board's chosen model, or the chosen study, is worth."""

    title = "Results"

    def state(self) -> Any:
        shown = self.view.detail
        if shown is None or shown[1] not in getattr(self.desk.session, shown[0]):
            return None
        return shown, tuple(self.desk.files(*shown))

    def draw(self) -> None:
        selection = self.view.detail
        if selection is None or selection[1] not in getattr(self.desk.session, selection[0]):
            note("Choose a model on the board, or a study of the twin.")
            return
        kind, key = selection
        entry = getattr(self.desk.session, kind)[key]
        ui.label(f"{key}  {heading(entry)}").classes("text-subtitle1 text-weight-bold break-words")
        if kind == "studies":
            for text in entry.sentences:
                ui.label(text).classes("text-body2 break-words")
        self._files(kind, key)
        if kind == "models":
            self._uses(key)
        self._figures(kind, key)
        if kind == "models" and entry.notes:
            with ui.expansion(f"Notes ({len(entry.notes)})", icon="notes").classes("w-full").props("dense"):
                for text in entry.notes:
                    ui.label(f"{capital(text)}.").classes("text-body2 break-words")

    def _uses(self, key: str) -> None:
        """Draw what can be done with a model and the record that is shown."""

        def refine() -> None:
            if self.view.key is not None:
                record = self.view.key
                attempt(lambda: self.desk.refine(key, record))

        def run() -> None:
            if self.view.key is not None:
                record, ahead = self.view.key, None if horizon.value is None else int(horizon.value)
                attempt(lambda: self.desk.run(record, key, ahead))

        with ui.row().classes("w-full gap-2 items-end"):
            ui.button("Refine", icon="tune", on_click=refine).props("outline dense no-caps data-mark=refine").classes(
                "q-px-sm"
            ).tooltip("fit it to the record under 1 Data, from the values that it has")
            ui.button("Run", icon="play_arrow", on_click=run).props("outline dense no-caps data-mark=run").classes(
                "q-px-sm"
            ).tooltip("run it on the record under 1 Data")
            horizon = ui.number("predict samples ahead", min=1, precision=0).classes("w-40")
            horizon.props("dense clearable data-mark=horizon")

    def _files(self, kind: str, key: str) -> None:
        with ui.row().classes("w-full gap-2 items-center"):
            for name, words in self.desk.files(kind, key).items():
                way = "open" if name == "report.html" else "download"
                link = ui.link(words, f"/files/{kind}/{key}/{name}", new_tab=way == "open")
                link.classes(f"qpal-file qpal-{way}").props(f"data-mark=file-{name}")
            if kind == "models" and "report.html" not in self.desk.files(kind, key):
                note("The report is being written.")

    def _figures(self, kind: str, key: str) -> None:
        """Draw the figures of a model or a study in tabs."""
        try:
            entries = self.desk.figures(kind, key)
        except InputError as error:
            note(str(error), "text-negative")
            return
        if not entries:
            return
        first = self.view.tab if self.view.tab in entries else next(iter(entries))
        with ui.tabs().classes("w-full qpal-tabs").props("dense no-caps align=left") as tabs:
            for name in entries:
                ui.tab(name, figures.tab_of(name)).props(f"data-mark=tab-{name}")
        with ui.tab_panels(tabs, value=first, animated=False).classes("w-full") as panels:
            for name, entry in entries.items():
                with ui.tab_panel(name).classes("q-pa-none"):
                    narrow = figures.stack_panels(entry["figure"])
                    plot = ui.plotly(figures.ready(entry["figure"])).classes("w-full").props(f"data-mark=figure-{name}")
                    if narrow is not None:
                        plot.classes("qpal-wide")
                        ui.plotly(figures.ready(narrow)).classes("w-full qpal-narrow")
                    note(" ".join(filter(None, (entry["caption"], figures.remark(entry["figure"])))))
        panels.on_value_change(lambda event: setattr(self.view, "tab", str(event.value)))


def rank(model: Model) -> float:
    """By which models stand on the board: the fit on the validation data [%]."""
    return -1e300 if model.fit_validation is None else model.fit_validation


def _fit_cell(fit: float | None) -> str:
    return "no finite fit" if fit is None else f"{fit:.1f}" if fit > -1000 else "below -1000"


def _cell(text: str, classes: str = "") -> None:
    with ui.element("td").classes(classes):
        ui.label(text)
