"""The record over time, on which a drag chooses the range, and what its preparation makes of it."""

from typing import Any

from nicegui import events, run, ui

from sysid.base.errors import InputError
from twin.app import figures
from twin.app.page.panel import Panel, note, said


class SignalsPanel(Panel):
    """Input and output of the shown record."""

    title = "Signals"

    def state(self) -> Any:
        key = self.view.key
        if key is None:
            return None
        entry = self.desk.session.data[key]
        return key, entry.notes, entry.prepare, entry.problem

    def draw(self) -> None:
        key = self.view.key
        if key is None:
            note("The signals of a record appear here.")
            return
        try:
            data = self.desk.record(key)
        except InputError as error:
            note(str(error))
            return
        asked = self.desk.session.data[key].prepare
        length = (data.N - 1) * data.Ts
        note(f"{data.N:,} samples every {data.Ts:g} s, {length:,.6g} s. Grey is left out; drag to choose a range.")
        plot = ui.plotly(figures.of_record(data, asked.start, asked.stop)).classes("w-full").props("data-mark=signals")
        plot.on("plotly_selected", self._dragged, args=["range"])
        plot.on("plotly_doubleclick", lambda: self._range(None, None), args=[])
        if (asked.resample, asked.low, asked.high) != (None, None, None):
            below = ui.column().classes("w-full gap-1")
            ui.timer(0.01, lambda: self._prepared(key, below), once=True)

    async def _prepared(self, key: str, below: ui.column) -> None:
        """The record after the steps that change its shape; they may take seconds, and the page goes on meanwhile."""
        try:
            found = await run.io_bound(self.desk.prepared, key)
        except InputError as error:
            with below:
                note(str(error), "text-negative")
            return
        if found is None:  # the app ends
            return
        data, sentences = found
        with below:
            note(f"Prepared: {'; '.join(sentences)}.")
            ui.plotly(figures.of_record(data, None, None, height=300)).classes("w-full")

    def _dragged(self, event: events.GenericEventArguments) -> None:
        ends = (event.args or {}).get("range", {}).get("x") if isinstance(event.args, dict) else None
        if not (isinstance(ends, list) and len(ends) == 2 and all(isinstance(end, int | float) for end in ends)):
            return
        self._range(*sorted(float(end) for end in ends))

    def _range(self, start: float | None, stop: float | None) -> None:
        key = self.view.key
        if key is None:
            return
        data = said(lambda: self.desk.record(key))
        if data is None or start is None or stop is None:
            said(lambda: self.desk.prepare(key, start=None, stop=None))
            return
        last = (data.N - 1) * data.Ts
        low = None if start <= 0 else round(start / data.Ts) * data.Ts
        high = None if stop >= last else round(stop / data.Ts) * data.Ts
        rounded = [None if end is None else float(f"{end:.9g}") for end in (low, high)]
        said(lambda: self.desk.prepare(key, start=rounded[0], stop=rounded[1]))
