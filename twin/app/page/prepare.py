"""Preparation of the record: the range, missing samples, another rate, a filter, offsets; and advice on it."""

from typing import Any

from nicegui import ui

from sysid.data.preparation import MISSING
from sysid.data.preprocess import DETREND
from twin.app.page.panel import Panel, note, said

BY_STRUCTURE = "by structure"
COLOURS = {"fine": "positive", "note": "info", "warning": "warning"}
ICONS = {"fine": "check_circle", "note": "info", "warning": "warning"}


class PreparePanel(Panel):
    """What is done before a fit."""

    title = "2  Prepare"

    def state(self) -> Any:
        key = self.view.key
        return key, None if key is None else self._entry().model_dump_json(include={"prepare", "columns", "problem"})

    def _entry(self) -> Any:
        assert self.view.key is not None
        return self.desk.session.data[self.view.key]

    def draw(self) -> None:
        key = self.view.key
        if key is None:
            note("Add a record first.")
            return
        now = self._entry().prepare
        note("Drag over the signals to choose a range, or type it. A double click there takes the range back.")
        fields: dict[str, Any] = {}
        with ui.grid(columns=2).classes("w-full gap-2"):
            for name, label in (
                ("start", "from [s]"),
                ("stop", "to [s]"),
                ("low", "high-pass above [Hz]"),
                ("high", "low-pass below [Hz]"),
                ("resample", "new sampling time [s]"),
            ):
                fields[name] = ui.number(label, value=getattr(now, name), min=0).props(
                    f"dense clearable data-mark={name}"
                )
            kinds = [BY_STRUCTURE, *DETREND]
            fields["detrend"] = ui.select(kinds, value=now.detrend or BY_STRUCTURE, label="offsets").props("dense")
            fields["missing"] = ui.select(list(MISSING), value=now.missing, label="missing samples").props("dense")

        def apply() -> None:
            chosen = {name: field.value for name, field in fields.items()}
            if chosen["detrend"] == BY_STRUCTURE:
                chosen["detrend"] = None
            said(lambda: self.desk.prepare(key, **chosen))

        def whole() -> None:
            said(lambda: self.desk.prepare(key, start=None, stop=None))

        with ui.row().classes("gap-2"):
            ui.button("Apply", on_click=apply).props("dense").classes("q-px-md").props("data-mark=apply")
            ui.button("Whole record", on_click=whole).props("flat dense")


class AdvicePanel(Panel):
    """What the record can show, and what to do about it."""

    title = "Advice"

    def state(self) -> Any:
        key = self.view.key
        return None if key is None else (key, self.desk.session.data[key].advice)

    def draw(self) -> None:
        key = self.view.key
        if key is None:
            return
        found = self.desk.session.data[key].advice
        if found is None:
            with ui.row().classes("items-center gap-2"):
                note("The record as it is prepared has no advice yet.")
                ui.button("Advise", on_click=lambda: said(lambda: self.desk.advise(key))).props("outline dense")
            return
        for each in sorted(found, key=lambda each: list(COLOURS).index(each.severity), reverse=True):
            with ui.row().classes("items-start no-wrap gap-2 w-full"):
                ui.icon(ICONS[each.severity], color=COLOURS[each.severity], size="18px")
                text = f"{each.sentence}: {each.action}" if each.action else each.sentence
                ui.label(text[:1].upper() + text[1:]).classes("text-body2 whitespace-normal break-words min-w-0")
