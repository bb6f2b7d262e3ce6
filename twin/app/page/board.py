"""The board of models, and the overlay of their free runs."""

from typing import Any

from nicegui import ui

from sysid.base.errors import InputError
from twin.app import figures
from twin.app.entries import Model
from twin.app.page.panel import Panel, note, tell
from twin.app.records import Runs

HEAD = (
    ("", "whether it is in the overlay"),
    ("model", "structure, orders and maps"),
    ("record", "the record that it was fitted to"),
    ("estimation [%]", "fit of the free run on the estimation data"),
    ("validation [%]", "fit of the free run on the validation data: 100 % is perfect, 0 % is the mean"),
    ("d", "number of free parameters"),
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
        ranked = sorted(models.items(), key=lambda item: -rank(item[1]))
        with (
            ui.element("div").classes("w-full overflow-x-auto"),
            ui.element("table").classes("qpal-table").props("data-mark=board"),
        ):
            with ui.element("tr"):
                for heading, meaning in HEAD:
                    with ui.element("th").classes("text-left"):
                        ui.label(heading).tooltip(meaning)
            for key, model in ranked:
                chosen = self.view.detail == ("models", key)
                with ui.element("tr").classes("bg-blue-1" if chosen else "").props(f"data-mark=model-{key}"):
                    self._row(key, model)
        self._overlay()

    def _row(self, key: str, model: Any) -> None:
        with ui.element("td"):
            ui.checkbox(
                value=key in self.view.overlaid, on_change=lambda event, key=key: self._tick(key, event.value)
            ).props("dense")
        with ui.element("td"):
            ui.button(f"{key}  {model.name.replace('_', ' ')}", on_click=lambda key=key: self._show(key)).props(
                "flat dense no-caps align=left"
            )
            if not model.converged:
                ui.icon("warning", color="warning").tooltip("the search did not converge; give more starts")
        _cell(model.data)
        for fit in (model.fit_estimation, model.fit_validation):
            _cell("no finite fit" if fit is None else f"{fit:.1f}" if fit > -1000 else "below -1000", NUMBERS)
        _cell(str(model.d), NUMBERS)
        _cell(f"{model.seconds:.1f}", NUMBERS)
        with ui.element("td"):
            ui.button(icon="delete", on_click=lambda key=key: self.desk.remove("models", key)).props(
                "flat dense round size=sm"
            ).tooltip("Delete this model")

    def _tick(self, key: str, on: bool) -> None:
        (self.view.overlaid.add if on else self.view.overlaid.discard)(key)

    def _show(self, key: str) -> None:
        self.view.detail = ("models", key)

    def _overlay(self) -> None:
        models = self.desk.session.models
        record = self.view.key or next(iter(models.values())).data  # models stay where every record was deleted
        chosen, others = self.desk.overlaid(self.view.overlaid, record)
        shown = dict[str, Runs]()
        for key in chosen:
            try:
                shown[figures.name_of(key, models[key].fit_validation)] = self.desk.runs(key)
            except InputError as error:
                tell(str(error))
        if others:
            note(f"Not shown below, because fitted to another record than {record}: {', '.join(others)}.")
        if not shown:
            note(f"Tick models of {record} to lay their free runs over its measured output.")
            return
        note(f"Record {record}:")
        ui.plotly(figures.overlay(shown)).classes("w-full").props("data-mark=overlay")
        note("Measured output and free runs; validation begins at the dotted line, and the legend has its fit.")


def rank(model: Model) -> float:
    """By which models stand on the board: the fit on the validation data [%]."""
    return -1e300 if model.fit_validation is None else model.fit_validation


def _cell(text: str, classes: str = "") -> None:
    with ui.element("td").classes(classes):
        ui.label(text)
