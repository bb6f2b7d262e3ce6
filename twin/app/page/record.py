"""Records: drop a log, make one with the twin, choose columns; prepare it, see its signals, read the advice on it."""

from typing import Any

from nicegui import events, run, ui

from sysid import excitations
from sysid.base.errors import InputError, readable
from sysid.base.locks import scratch_folder
from sysid.base.quantities import capital
from sysid.data.preparation import MISSING
from sysid.data.preprocess import DETREND
from sysid.formats import TABLE as FORMATS
from twin.app import figures
from twin.app.desk import display_name, several, suffix_of
from twin.app.entries import LARGEST, Data
from twin.app.page.panel import Panel, RecordPanel, attempt, delete_button, note, tell
from twin.imperfections import TABLE as IMPERFECTIONS
from twin.parameters import JOINTS

FIELDS = (  # for options of the command line that a sentence may name
    "Choose input, output and time below, or the sampling time, then Read again. What has no field here, such as a "
    "unit or a range, is an option of the command qpal info, or a line of its mapping file."
)
BY_STRUCTURE = "by structure"
COLOURS = {"fine": "positive", "note": "info", "warning": "warning"}
ICONS = {"fine": "check_circle", "note": "info", "warning": "warning"}


class DataPanel(Panel):
    """The list of records, and ways to add one."""

    title = "1  Data"

    def state(self) -> Any:
        return tuple((key, entry.name, entry.problem, entry.columns) for key, entry in self._entries()), self.view.key

    def _entries(self) -> list[tuple[str, Any]]:
        return list(self.desk.session.data.items())

    def draw(self) -> None:
        if not self._entries():
            note("No record yet: drop a log below, or make one with the twin.")
            return
        options = {key: f"{key}  {entry.name}" for key, entry in self._entries()}
        with ui.row().classes("w-full items-center no-wrap gap-1"):
            choose = ui.select(options, value=self.view.key, label="record").classes("grow min-w-0")
            choose.on_value_change(lambda e: self.desk.session.change(shown=e.value))
            delete_button(self._remove, "Delete this record from the session")
        key = self.view.key
        assert key is not None
        entry = self.desk.session.data[key]
        if entry.problem:
            note(entry.problem, "text-negative")
            if entry.columns:
                note(FIELDS)
        if entry.columns:
            with ui.expansion("Columns", value=bool(entry.problem)).classes("w-full").props("dense"):
                self._columns(key)

    def _columns(self, key: str) -> None:
        """Draw the choice of columns, and what was assumed on reading."""
        entry = self.desk.session.data[key]
        options = {None: "found by name and unit"} | {name: readable(name) for name in entry.columns}
        fields: dict[str, Any] = {}
        columns = {name: readable(name) for name in entry.columns}
        for role in ("input", "output"):
            chosen = [*several(getattr(entry, role), entry.columns)]
            words = f"{role}, or several{'' if chosen else '; none: by name'}"
            fields[role] = ui.select(columns, multiple=True, value=chosen, label=words, clearable=True)
            fields[role].classes("w-full min-w-0").props(f"dense use-chips options-dense data-mark=column-{role}")
        fields["time"] = ui.select(options, value=entry.time, label="time").classes("w-full").props("dense")
        Ts = ui.number("sampling time [s] without a clock", value=entry.Ts, min=0).classes("w-full")

        def read() -> None:
            chosen = {role: ",".join(fields[role].value or ()) or None for role in ("input", "output")}
            attempt(lambda: self.desk.choose_columns(key, **chosen, time=fields["time"].value, Ts=Ts.value))

        ui.button("Read again", on_click=read).props("outline dense data-mark=read")
        for text in entry.notes:
            note(text)

    def _remove(self) -> None:
        if self.view.key is not None:
            self.desk.remove("data", self.view.key)

    def foot(self) -> None:
        upload = ui.upload(label="Drop a log here", auto_upload=True, max_file_size=LARGEST, on_upload=self._add_upload)
        upload.on_rejected(lambda: tell(f"a log is one file of at most {LARGEST // 2**20} MiB: {', '.join(FORMATS)}"))
        upload.props(f'accept="{",".join(FORMATS)}" flat bordered').classes("w-full")
        with ui.expansion("Make a log with the twin", icon="precision_manufacturing").classes("w-full").props("dense"):
            self._twin()

    async def _add_upload(self, event: events.UploadEventArguments) -> None:
        name = display_name(event.file.name)
        with scratch_folder() as folder:
            try:
                path = folder / f"log{suffix_of(name)}"
                await event.file.save(path)
                self.desk.add_log(name, path)
            except InputError as error:
                tell(str(error))
        event.sender.reset()  # type: ignore[attr-defined]

    def _twin(self) -> None:
        """Draw the form of an experiment on the twin."""
        settings = self.desk.session.head.twin
        with ui.grid(columns=2).classes("w-full gap-2"):
            joint = ui.select(list(JOINTS), value=settings.joint, label="joint").props("dense")
            signal = ui.select(list(excitations.TABLE), value=settings.excitation, label="excitation").props("dense")
            duration = ui.number("duration [s]", value=settings.duration, min=1).props("dense")
            Ts = ui.number("sampling time [s]", value=settings.Ts, min=0.001, step=0.01).props("dense")
            seed = ui.number("seed", value=settings.seed, min=0, precision=0).props("dense")
        ui.label("Imperfections").classes("text-caption text-grey-8")
        with ui.row().classes("w-full gap-x-3 gap-y-0"):
            switches = {
                name: ui.checkbox(name.replace("_", " "), value=name not in settings.without).props("dense size=sm")
                for name in IMPERFECTIONS
            }

        def make() -> None:
            omitted_effects = tuple(name for name, box in switches.items() if not box.value)

            def run() -> None:
                choice = {"joint": joint.value, "excitation": signal.value, "duration": duration.value, "Ts": Ts.value}
                self.desk.make(**choice, seed=seed.value, without=omitted_effects)

            attempt(run)

        ui.button("Run the twin", icon="play_arrow", on_click=make).props("data-mark=make")


class PreparePanel(RecordPanel):
    """What is done before a fit."""

    title = "2  Prepare"
    fields = ("prepare", "columns", "problem")
    empty = "Add a record first."

    def draw_record(self, key: str, entry: Data) -> None:
        steps = entry.prepare
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
                fields[name] = ui.number(label, value=getattr(steps, name), min=0).props(
                    f"dense clearable data-mark={name}"
                )
            kinds = [BY_STRUCTURE, *DETREND]
            fields["detrend"] = ui.select(kinds, value=steps.detrend or BY_STRUCTURE, label="offsets").props("dense")
            fields["missing"] = ui.select(list(MISSING), value=steps.missing, label="missing samples").props("dense")

        def apply() -> None:
            values = {name: field.value for name, field in fields.items()}
            if values["detrend"] == BY_STRUCTURE:
                values["detrend"] = None
            attempt(lambda: self.desk.prepare(key, **values))

        def clear_range() -> None:
            attempt(lambda: self.desk.prepare(key, start=None, stop=None))

        with ui.row().classes("gap-2"):
            ui.button("Apply", on_click=apply).props("dense").classes("q-px-md").props("data-mark=apply")
            ui.button("Whole record", on_click=clear_range).props("flat dense")


class SignalsPanel(RecordPanel):
    """Input and output of the shown record."""

    title = "Signals"
    fields = ("notes", "prepare", "problem")
    empty = "The signals of a record appear here."

    def draw_record(self, key: str, entry: Data) -> None:
        data, steps = self.samples(key), entry.prepare
        if data is None:
            return
        length = (data.N - 1) * data.Ts
        note(f"{data.N:,} samples every {data.Ts:g} s, {length:,.6g} s. Grey is left out; drag to choose a range.")
        plot = ui.plotly(figures.of_record(data, steps.start, steps.stop)).classes("w-full").props("data-mark=signals")
        plot.on("plotly_selected", self._choose_range, args=["range"])
        plot.on("plotly_doubleclick", lambda: self._range(None, None), args=[])
        if (steps.resample, steps.low, steps.high) != (None, None, None):
            box = ui.column().classes("w-full gap-1")
            ui.timer(0.01, lambda: self._show_prepared(key, box), once=True)

    async def _show_prepared(self, key: str, box: ui.column) -> None:
        """The record after the steps that change its shape; they may take seconds, and the page goes on meanwhile."""
        try:
            result = await run.io_bound(self.desk.prepared_record, key)
        except InputError as error:
            with box:
                note(str(error), "text-negative")
            return
        if result is None:  # the app ends
            return
        data, sentences = result
        with box:
            note(f"Prepared: {'; '.join(sentences)}.")
            ui.plotly(figures.of_record(data, None, None, height=300)).classes("w-full")

    def _choose_range(self, event: events.GenericEventArguments) -> None:
        ends = (event.args or {}).get("range", {}).get("x") if isinstance(event.args, dict) else None
        if not (isinstance(ends, list) and len(ends) == 2 and all(isinstance(end, int | float) for end in ends)):
            return
        self._range(*sorted(float(end) for end in ends))

    def _range(self, start: float | None, stop: float | None) -> None:
        """Set the range [s] in whole samples; all of the record without two ends."""
        key = self.view.key
        if key is None:
            return
        data = attempt(lambda: self.desk.record(key))
        if data is None or start is None or stop is None:
            attempt(lambda: self.desk.prepare(key, start=None, stop=None))
            return
        last = (data.N - 1) * data.Ts
        low = None if start <= 0 else round(start / data.Ts) * data.Ts
        high = None if stop >= last else round(stop / data.Ts) * data.Ts
        ends = [None if end is None else float(f"{end:.9g}") for end in (low, high)]
        attempt(lambda: self.desk.prepare(key, start=ends[0], stop=ends[1]))


class AdvicePanel(RecordPanel):
    """What the record can show, and what to do about it."""

    title = "Advice"
    fields = ("advice",)

    def draw_record(self, key: str, entry: Data) -> None:
        findings = entry.advice
        if findings is None:
            with ui.row().classes("items-center gap-2"):
                note("The record as it is prepared has no advice yet.")
                ui.button("Advise", on_click=lambda: attempt(lambda: self.desk.advise(key))).props("outline dense")
            return
        for finding in sorted(findings, key=lambda finding: list(COLOURS).index(finding.severity), reverse=True):
            with ui.row().classes("items-start no-wrap gap-2 w-full"):
                ui.icon(ICONS[finding.severity], color=COLOURS[finding.severity], size="18px")
                text = f"{finding.sentence}: {finding.action}" if finding.action else finding.sentence
                ui.label(capital(text)).classes("text-body2 whitespace-normal break-words min-w-0")
