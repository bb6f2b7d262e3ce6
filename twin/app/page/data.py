"""Records: drop a log, make one with the twin, choose columns."""

from typing import Any

from nicegui import events, ui

from sysid import excitations
from sysid.base.errors import InputError
from sysid.base.leftovers import scratch
from sysid.formats import TABLE as FORMATS
from twin.app.desk import displayed, suffix_of
from twin.app.guard import LARGEST
from twin.app.page.panel import Panel, note, said, tell
from twin.imperfections import TABLE as IMPERFECTIONS
from twin.parameters import JOINTS

FIELDS = (  # for options of the command line that a sentence may name
    "Choose input, output and time below, or the sampling time, then Read again. What has no field here, such as a "
    "unit or a range, is an option of the command qpal info, or a line of its mapping file."
)


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
            ui.button(icon="delete", on_click=self._remove).props("flat dense round").tooltip(
                "Delete this record from the session"
            )
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
        entry = self.desk.session.data[key]
        options = {None: "found by name and unit"} | {name: name for name in entry.columns}
        fields = {}
        for role in ("input", "output", "time"):
            fields[role] = ui.select(options, value=getattr(entry, role), label=role).classes("w-full").props("dense")
        Ts = ui.number("sampling time [s], without a time column", value=entry.Ts, min=0).classes("w-full")

        def read() -> None:
            chosen = {role: select.value for role, select in fields.items()}
            said(lambda: self.desk.choose_columns(key, **chosen, Ts=Ts.value))

        ui.button("Read again", on_click=read).props("outline dense")
        for text in entry.notes:
            note(text)

    def _remove(self) -> None:
        if self.view.key is not None:
            self.desk.remove("data", self.view.key)

    def foot(self) -> None:
        upload = ui.upload(label="Drop a log here", auto_upload=True, max_file_size=LARGEST, on_upload=self._uploaded)
        upload.on_rejected(lambda: tell(f"a log is one file of at most {LARGEST // 2**20} MiB: {', '.join(FORMATS)}"))
        upload.props(f'accept="{",".join(FORMATS)}" flat bordered').classes("w-full")
        with ui.expansion("Make a log with the twin", icon="precision_manufacturing").classes("w-full").props("dense"):
            self._twin()

    async def _uploaded(self, event: events.UploadEventArguments) -> None:
        name = displayed(event.file.name)
        with scratch() as folder:
            try:
                path = folder / f"log{suffix_of(name)}"
                await event.file.save(path)
                self.desk.add_log(name, path)
            except InputError as error:
                tell(str(error))
        event.sender.reset()  # type: ignore[attr-defined]

    def _twin(self) -> None:
        known = self.desk.session.head.twin
        with ui.grid(columns=2).classes("w-full gap-2"):
            joint = ui.select(list(JOINTS), value=known.joint, label="joint").props("dense")
            signal = ui.select(list(excitations.TABLE), value=known.excitation, label="excitation").props("dense")
            duration = ui.number("duration [s]", value=known.duration, min=1).props("dense")
            Ts = ui.number("sampling time [s]", value=known.Ts, min=0.001, step=0.01).props("dense")
            seed = ui.number("seed", value=known.seed, min=0, precision=0).props("dense")
        ui.label("Imperfections").classes("text-caption text-grey-8")
        with ui.row().classes("w-full gap-x-3 gap-y-0"):
            switches = {
                name: ui.checkbox(name.replace("_", " "), value=name not in known.without).props("dense size=sm")
                for name in IMPERFECTIONS
            }

        def make() -> None:
            without = tuple(name for name, box in switches.items() if not box.value)

            def run() -> None:
                asked = {"joint": joint.value, "excitation": signal.value, "duration": duration.value, "Ts": Ts.value}
                self.desk.make(**asked, seed=seed.value, without=without)

            said(run)

        ui.button("Run the twin", icon="play_arrow", on_click=make).props("data-mark=make")
