"""One model or one study: its figures in tabs, its notes, and its files to take away."""

from typing import Any

from nicegui import ui

from sysid.base.errors import InputError
from twin.app import figures
from twin.app.page.panel import Panel, note


class DetailPanel(Panel):
    """What the board's chosen model, or the chosen study, is worth."""

    title = "Results"

    def state(self) -> Any:
        shown = self.view.detail
        if shown is None or shown[1] not in getattr(self.desk.session, shown[0]):
            return None
        return shown, tuple(self.desk.files(*shown))

    def draw(self) -> None:
        shown = self.view.detail
        if shown is None or shown[1] not in getattr(self.desk.session, shown[0]):
            note("Choose a model on the board, or a study of the twin.")
            return
        kind, key = shown
        entry = getattr(self.desk.session, kind)[key]
        heading = entry.name.replace("_", " ") if kind == "models" else f"{entry.joint}, {entry.kind}"
        ui.label(f"{key}  {heading}").classes("text-subtitle1 text-weight-bold break-words")
        if kind == "studies":
            for text in entry.sentences:
                ui.label(text).classes("text-body2 break-words")
        self._files(kind, key)
        self._figures(kind, key)
        if kind == "models" and entry.notes:
            with ui.expansion(f"Notes ({len(entry.notes)})", icon="notes").classes("w-full").props("dense"):
                for text in entry.notes:
                    ui.label(f"{text[:1].upper()}{text[1:]}.").classes("text-body2 break-words")

    def _files(self, kind: str, key: str) -> None:
        with ui.row().classes("w-full gap-2 items-center"):
            for name, words in self.desk.files(kind, key).items():
                way = "open" if name == "report.html" else "download"
                link = ui.link(words, f"/files/{kind}/{key}/{name}", new_tab=way == "open")
                link.classes(f"qpal-file qpal-{way}").props(f"data-mark=file-{name}")
            if kind == "models" and "report.html" not in self.desk.files(kind, key):
                note("The report is being written.")

    def _figures(self, kind: str, key: str) -> None:
        try:
            found = self.desk.figures(kind, key)
        except InputError as error:
            note(str(error), "text-negative")
            return
        if not found:
            return
        first = self.view.tab if self.view.tab in found else next(iter(found))
        with ui.tabs().classes("w-full qpal-tabs").props("dense no-caps align=left") as tabs:
            for name in found:
                ui.tab(name, figures.TITLES.get(name, "Run")).props(f"data-mark=tab-{name}")
        with ui.tab_panels(tabs, value=first, animated=False).classes("w-full") as panels:
            for name, each in found.items():
                with ui.tab_panel(name).classes("q-pa-none"):
                    narrow = figures.below(each["figure"])
                    plot = ui.plotly(figures.ready(each["figure"])).classes("w-full").props(f"data-mark=figure-{name}")
                    if narrow is not None:
                        plot.classes("qpal-wide")
                        ui.plotly(figures.ready(narrow)).classes("w-full qpal-narrow")
                    note(" ".join(filter(None, (each["caption"], figures.said(each["figure"])))))
        panels.on_value_change(lambda event: setattr(self.view, "tab", str(event.value)))
