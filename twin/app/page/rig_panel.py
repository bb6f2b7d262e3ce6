"""The rig: connect it, check its wires, watch it, stop it, run an input; the log is a record like any other."""

from collections.abc import Callable
from typing import Any

from nicegui import events, run, ui

from sysid.base.errors import InputError
from sysid.base.quantities import capital
from sysid.formats import TABLE as FORMATS
from twin.app.desk import display_name, suffix_of
from twin.app.entries import LARGEST, Setting
from twin.app.page.panel import Panel, View, attempt, note
from twin.app.page.rig_live import BEAT
from twin.app.rig import CONNECTING, OFF, READY
from twin.app.rig_words import sentences
from twin.parameters import JOINTS

EMULATED, SWEEP, UPLOAD = "emulated leg", "sweep", "upload"


class RigPanel(Panel):
    """Everything that is done with a rig, from top to bottom."""

    title = "Rig"

    def __init__(self, view: View, leave: Callable[[], object]) -> None:
        self.rig, self._leave = view.desk.rig, leave
        self._values: dict[str, Any] = {
            "port": EMULATED,
            "leg": JOINTS[1],
            "seed": 1,
            "speed": 2.0,
            "file": "",
            "joint": JOINTS[1],
            "channel": 1,
            "supply": 12.0,
            "largest": 12.0,
            "input": None,
            "angle": None,
            "open": True,
        }
        self._known = False  # whether the ends had angles when this was last drawn
        self._asked = ""  # what waits for a yes in this window
        self._readings: ui.label | None = None
        self._question: Any = None
        super().__init__(view)
        ui.timer(BEAT, self._show_readings)

    def state(self) -> Any:
        records = tuple((key, entry.name) for key, entry in self.desk.session.data.items())
        return self.rig.version, self._asked, records

    def draw(self) -> None:
        rig = self.rig
        self._readings = None
        if rig.state in (OFF, CONNECTING):
            self._connection()
        else:
            self._connected()
        if rig.result or "run" in rig.problems:
            self._result()

    # Connect.

    def _connection(self) -> None:
        note("A joint on a board with the rig's firmware, or a leg of the twin in its place. Nothing moves yet.")
        try:
            ports = self.rig.ports()
        except InputError as error:  # pyserial is missing
            ports = {}
            note(f"{capital(str(error))}.", "text-negative")
        names = {EMULATED: "emulated leg of the twin"} | {name: f"{name}  {text}" for name, text in ports.items()}
        port = self._values["port"]
        names.setdefault(port, port)
        with ui.row().classes("w-full items-center no-wrap gap-1"):
            select = ui.select(names, label="port, or type its name", with_input=True, new_value_mode="add-unique")
            select.bind_value(self._values, "port").classes("grow min-w-0").props("data-mark=rig-port")
            ui.button(icon="refresh", on_click=self._draw_again).props("flat dense round").tooltip(
                "List the ports anew"
            )
        with (
            ui.grid(columns=3)
            .classes("w-full gap-2")
            .bind_visibility_from(self._values, "port", lambda value: value == EMULATED)
        ):
            ui.select(list(JOINTS), label="joint").bind_value(self._values, "leg").props("dense data-mark=rig-leg")
            self._number("seed", "seed", min=0, precision=0)
            self._number("speed", "times its speed", min=0.1, max=100)
        button = (
            ui.button("Connect", icon="cable", on_click=self._connect).classes("w-full").props("data-mark=rig-connect")
        )
        if self.rig.state == CONNECTING:
            button.disable()
            note("It is greeted; this takes some seconds.")
        self._problem("connect")

    def _connect(self) -> None:
        port, values = self._values["port"], self._values
        if port != EMULATED:
            self.rig.connect(str(port or ""))
        else:
            self.rig.connect(None, str(values["leg"]), int(values["seed"] or 0), float(values["speed"] or 1.0))
            values |= {"joint": values["leg"], "channel": JOINTS.index(values["leg"])}

    def _draw_again(self) -> None:
        self._seen = self

    # Connected.

    def _connected(self) -> None:
        rig = self.rig
        assert rig.port is not None
        with ui.row().classes("w-full items-center no-wrap gap-1"):
            ui.label(f"{rig.port.name}: {rig.port.firmware}").classes("grow break-words min-w-0").props(
                "data-mark=rig-who"
            )
            ui.button("Disconnect", on_click=self._disconnect).props("flat dense no-caps data-mark=rig-disconnect")
        self._readings = ui.label("").classes("text-caption text-grey-8 tabular-nums").props("data-mark=rig-readings")
        self._calibration()
        if rig.calibration is not None and rig.calibration.is_zeroed:
            self._run()

    def _show_readings(self) -> None:
        """What the sensors read, as often as they are asked."""
        rig = self.rig
        if self._readings is None or rig.port is None or not rig.seen.readings:
            return
        text = ", ".join(f"joint {k}: {counts}" for k, counts in enumerate(rig.seen.readings))
        if rig.driving and rig.seen.rows:
            text = f"of the joint that moves: {rig.seen.rows[-1][1]}"
        self._readings.set_text(f"Readings {text} of {rig.port.full}")

    async def _disconnect(self) -> None:
        await run.io_bound(self.rig.disconnect)

    def _calibration(self) -> None:
        """What is known of the joint, and the ways to know it: of use until the ends have angles."""
        rig, values = self.rig, self._values
        ui.label("Calibration").classes("text-subtitle2")
        if rig.calibration is None:
            note("None yet: check the wiring, or take that of a file.")
        for sentence in sentences(rig.calibration) if rig.calibration else ():
            note(f"{capital(sentence)}.")
        assert rig.port is not None
        if rig.calibration is not None and not rig.port.emulated and rig.calibration.port != rig.port.name:
            note(f"It was found on {rig.calibration.port}: is this the same board?", "text-warning")
        known = rig.calibration is not None and rig.calibration.is_zeroed
        if known != self._known:
            self._known, values["open"] = known, not known
        with ui.expansion("Wiring and ends").classes("w-full").props("dense data-mark=rig-wiring") as box:
            box.bind_value(values, "open")
            with ui.row().classes("w-full items-center no-wrap gap-1"):
                field = ui.input("path of a rig.toml on this machine").bind_value(values, "file")
                field.props("dense data-mark=rig-file").classes("grow min-w-0")
                ui.button("Take", on_click=lambda: rig.use(values["file"])).props("outline dense data-mark=rig-take")
            self._problem("calibration")
            self._wiring()
        if rig.question is not None:
            self._ask_angle()
        for sentence in rig.said:
            note(f"{capital(sentence)}.")

    def _wiring(self) -> None:
        """The wire check and the run to the ends, each with its warning first."""
        rig, values = self.rig, self._values
        with ui.grid(columns=2).classes("w-full gap-2"):
            ui.input("joint, its name in logs").bind_value(values, "joint").props("dense data-mark=rig-joint")
            self._number("channel", "its number on the board", min=0, max=2, precision=0)
            self._number("supply", "supply [V]", min=0)
            self._number("largest", "largest input [V]", min=0)

        def check() -> None:
            rig.find_wiring(str(values["joint"] or ""), values["channel"], values["supply"], values["largest"])

        warning = f"The {values['joint']} will move a little, both ways. Keep clear of it."
        self._order("wire", "Check the wiring", warning, check)
        if rig.calibration is not None:
            warning = f"The {rig.calibration.joint} will run slowly into both of its ends. Keep clear of it."
            self._order("zero", "Find the ends", warning, rig.find_ends)

    def _ask_angle(self) -> None:
        """The angle of the end at which the joint stands."""
        question, values = self.rig.question, self._values
        assert question is not None
        if self._question is not question:
            self._question, values["angle"] = question, question.guess
        with ui.card().classes("w-full gap-1 q-pa-sm bg-amber-1").props("flat bordered data-mark=rig-question"):
            ui.label(f"The joint stands at its {question.end} end, at {question.counts:.0f} counts.").classes(
                "text-body2"
            )
            if question.guess is not None:
                note("The protractor of the emulated leg says:")
            self._number("angle", "angle there [deg]")
            ui.button("Go on", on_click=lambda: self.rig.answer(values["angle"])).props("dense data-mark=rig-answer")
            self._problem("question")

    def _run(self) -> None:
        """Choose an input and play it."""
        rig, chosen = self.rig, self.rig.chosen
        assert rig.calibration is not None
        ui.label("Run").classes("text-subtitle2")
        options = {SWEEP: "a first sweep"}
        options |= {key: f"{key}  {entry.name}: its input" for key, entry in self.desk.session.data.items()}
        if chosen is not None and chosen.key == UPLOAD:
            options[UPLOAD] = chosen.name
        self._values["input"] = chosen.key if chosen is not None and chosen.key in options else None
        select = ui.select(options, label="input", value=self._values["input"]).classes("w-full")
        select.props("dense data-mark=rig-input").on_value_change(lambda event: self._choose(event.value))
        upload = ui.upload(
            label="or drop a design here", auto_upload=True, max_file_size=LARGEST, on_upload=self._upload
        )
        upload.props(f'accept="{",".join(FORMATS)}" flat bordered data-mark=rig-upload').classes("w-full")
        self._problem("input")
        if chosen is not None:
            note(f"{capital(chosen.name)}: {chosen.words}.")
            length = len(chosen.u) * chosen.Ts
            warning = (
                f"The {rig.calibration.joint} will move for {length:.0f} s. Keep clear of it, and a hand on the switch."
            )
            self._order("run", "Run", warning, rig.run)

    def _choose(self, key: str | None) -> None:
        if key == SWEEP:
            self.rig.choose(SWEEP, "first sweep", None)
        elif key in self.desk.session.data:
            self.rig.choose(key, self.desk.session.data[key].name, self.desk.session.log(key))

    async def _upload(self, event: events.UploadEventArguments) -> None:
        """Look at a dropped file; its name is shown, and never used as a path."""
        name = display_name(event.file.name)
        try:
            path = self.rig.folder / "rig" / f"input{suffix_of(name)}"
        except InputError as error:
            self.rig.problems["input"] = str(error)
            self._draw_again()
            return
        await event.file.save(path)
        self.rig.choose(UPLOAD, name, path)

    def _result(self) -> None:
        """What the last run has left."""
        rig = self.rig
        self._problem("run")
        if not rig.record or rig.record not in self.desk.session.data:
            return
        note(f"The log is record {rig.record} of this session: {rig.result}.")

        def identify() -> None:
            self.desk.fit(rig.record, Setting(structure="actuated_joint"))
            self._leave()

        ui.button("Identify the joint", icon="play_arrow", on_click=lambda: attempt(identify)).props(
            "outline dense data-mark=rig-identify"
        ).classes("q-px-sm")

    # What these share.

    def _order(self, name: str, words: str, warning: str, action: Callable[[], None]) -> None:
        """A button that asks before something moves, and the sentence of what went wrong beside it."""
        rig = self.rig

        def ask() -> None:
            self._asked = name

        def confirm() -> None:
            self._asked = ""
            if rig.state == READY:
                self.view.moves = True
            action()

        def leave() -> None:
            self._asked = ""

        if self._asked == name and rig.state == READY:
            with ui.card().classes("w-full gap-1 q-pa-sm bg-amber-1").props("flat bordered"):
                ui.label(warning).classes("text-body2")
                with ui.row().classes("gap-2"):
                    ui.button("Move it", on_click=confirm).props(f"dense color=accent data-mark=rig-yes-{name}")
                    ui.button("Not now", on_click=leave).props("flat dense no-caps")
        else:
            button = ui.button(words, on_click=ask).classes("w-full q-mt-sm").props(f"outline data-mark=rig-{name}")
            button.set_enabled(rig.state == READY)
        if name != "run":
            self._problem(name)

    def _number(self, key: str, label: str, **options: Any) -> None:
        ui.number(label, **options).bind_value(self._values, key).props(f"dense data-mark=rig-{key}")

    def _problem(self, place: str) -> None:
        if place in self.rig.problems:
            note(f"{capital(self.rig.problems[place])}.", "text-negative")
