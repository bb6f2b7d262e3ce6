"""Structures to fit, and the jobs that run."""

from functools import partial
from typing import Any

from nicegui import ui

from sysid.base.errors import InputError
from sysid.structures import TABLE as STRUCTURES
from twin.app.entries import AUTO, SEARCHED, Setting
from twin.app.jobs import CANCELLED, FAILED, Job
from twin.app.page.panel import Panel, attempt, note, tell

DEFAULT = "default"
EMPTY = {"name": "", "value": None, "low": None, "high": None}  # of a parameter that is held
FIRST = ("output_error", "hammerstein_wiener")  # ticked at first: a linear one, and the toolbox's own


class FitPanel(Panel):
    """Tick structures, set their orders and maps, and fit them all."""

    title = "3  Fit"

    def __init__(self, view: Any) -> None:
        self._ticked: set[str] = set(FIRST)
        self._values: dict[str, dict[str, Any]] = {}
        setting = view.desk.session.head.setting
        self._common: dict[str, Any] = {"starts": setting.starts, "seed": setting.seed, "split": setting.split}
        self._search: dict[str, Any] = {"seconds": SEARCHED}
        self._held: list[dict[str, Any]] = []
        self._records: dict[str, list[str]] = {"further": [], "validation": []}
        super().__init__(view)

    def state(self) -> Any:
        return tuple(sorted(self._ticked)), self.view.key, tuple(self.desk.session.data), len(self._held)

    def draw(self) -> None:
        self._draw_records()
        with ui.row().classes("w-full items-end no-wrap gap-2"):
            search = ui.button("Search for a structure", icon="travel_explore", on_click=self._auto)
            search.props("no-caps outline data-mark=auto").classes("grow")
            ui.number("at most [s]", min=1, precision=0).bind_value(self._search, "seconds").props(
                "dense data-mark=seconds"
            ).classes("w-20")
        note("It tries linear and nonlinear structures of several sizes. Or tick structures and press Fit:")
        for name, kind in STRUCTURES.items():
            ui.checkbox(
                name.replace("_", " "),
                value=name in self._ticked,
                on_change=lambda event, name=name: self._tick(name, event.value),
            ).props("dense").props(f"data-mark=structure-{name}").tooltip((kind.__doc__ or "").split("\n")[0])
            if name in self._ticked:
                self._settings(name, kind)
        self._draw_held()
        ui.separator()
        with ui.grid(columns=3).classes("w-full gap-2"):
            for field, label, options in (
                ("starts", "starts", {"min": 1, "precision": 0}),
                ("seed", "seed", {"min": 0, "precision": 0}),
                ("split", "estimation part", {"min": 0.1, "max": 0.9, "step": 0.05}),
            ):
                ui.number(label, **options).bind_value(self._common, field).props(f"dense data-mark={field}")
        ui.button("Fit", icon="play_arrow", on_click=self._fit).classes("w-full").props("data-mark=fit")

    def _draw_records(self) -> None:
        """Draw the choice of further records, where the session has some."""
        key, data = self.view.key, self.desk.session.data
        options = {other: f"{other}  {entry.name}" for other, entry in data.items() if other != key}
        self._records = {role: [other for other in keys if other in options] for role, keys in self._records.items()}
        if not options:
            return
        for role, label in (("further", "fit these records too"), ("validation", "records that judge the model")):
            choose = ui.select(options, multiple=True, label=label, value=self._records[role])
            choose.bind_value(self._records, role).props(f"dense use-chips options-dense data-mark={role}")
            choose.classes("w-full min-w-0")

    def _tick(self, name: str, on: bool) -> None:
        (self._ticked.add if on else self._ticked.discard)(name)

    def _settings(self, name: str, kind: Any) -> None:
        """Draw a field for each setting of a structure."""
        values = self._values.setdefault(name, {})
        with ui.grid(columns=3).classes("w-full gap-x-2 gap-y-0 q-pl-md"):
            for field, option in kind.options().items():
                default = getattr(kind, field, None)
                values.setdefault(field, default)
                words = field.replace("_", " ")
                entry: Any
                if option.kind == "order":
                    entry = ui.number(field, min=option.least, max=100, precision=0)
                elif option.kind == "number":
                    entry = ui.number(f"{words} [{option.unit}]" if option.unit else words).props("clearable")
                else:
                    names = {name: name.replace("_", " ") for name in option.allowed}
                    choices: dict[Any, str] = ({None: DEFAULT} if default is None else {}) | names
                    entry = ui.select(choices, label=words).props("options-dense").classes("min-w-0")
                entry.bind_value(values, field).props("dense").tooltip(option.help).props(f"data-mark={name}-{field}")

    def _draw_held(self) -> None:
        """Draw the parameters that are held at a value or between two, and a button for one more."""
        names = sorted({name for structure in self._ticked for name in _parameters(structure)})
        for k, row in enumerate(self._held):
            with ui.grid().classes("w-full gap-x-2 gap-y-0").style("grid-template-columns: 2fr 1fr 1fr 1fr"):
                ui.input("parameter", autocomplete=names).bind_value(row, "name").props(f"dense data-mark=held-{k}")
                for field, label in (("value", "held at"), ("low", "least"), ("high", "most")):
                    ui.number(label).bind_value(row, field).props(f"dense data-mark=held-{k}-{field}")
        add = ui.button("Hold or bound a parameter", icon="lock", on_click=lambda: self._held.append(dict(EMPTY)))
        add.props("flat dense no-caps size=sm data-mark=hold").tooltip(f"such as {', '.join(names[:6])}")

    def _record(self) -> str | None:
        """The record that is shown; None, and a message says so, where there is none."""
        if self.view.key is None:
            tell("add a record first: drop a log, or make one with the twin")
        return self.view.key

    def _auto(self) -> None:
        key = self._record()
        if key is not None:
            setting = {"structure": AUTO, "seconds": self._search["seconds"] or SEARCHED, **self._common}
            attempt(lambda: self.desk.fit(key, self.desk.setting(**setting), **self._records))

    def _fit(self) -> None:
        key = self._record()
        if key is None:
            return
        if not self._ticked:
            tell("tick at least one structure")
        for name in STRUCTURES:
            if name in self._ticked:
                attempt(partial(self._begin, key, name))

    def _begin(self, key: str, name: str) -> None:
        self.desk.fit(key, self._setting(name), **self._records)

    def _setting(self, name: str) -> Setting:
        """The setting that the fields of a structure hold; raises InputError for a missing order."""
        kind = STRUCTURES[name]
        settings = {}
        for field, option in kind.options().items():
            value = self._values[name].get(field)
            if value is None:
                if option.kind == "order":
                    raise InputError(f"{name} has no {field}; give a whole number of at least {option.least}")
                continue
            settings[field] = int(value) if option.kind == "order" else value
        rows = [row for row in self._held if row["name"]]
        fixed = {row["name"].strip(): row["value"] for row in rows if row["value"] is not None}
        bounds = {row["name"].strip(): (row["low"], row["high"]) for row in rows}
        bounds = {parameter: ends for parameter, ends in bounds.items() if ends != (None, None)}
        return self.desk.setting(structure=name, settings=settings, fixed=fixed, bounds=bounds, **self._common)


def _parameters(structure: str) -> list[str]:
    """The names of the parameters of a structure as it is without settings."""
    model = STRUCTURES[structure]().model()
    return list(getattr(model, "names", ()))


class JobsPanel(Panel):
    """What runs, waits or failed, with a button to cancel."""

    title = "Jobs"

    def __init__(self, view: Any) -> None:
        self._bars: dict[Job, tuple[ui.linear_progress, ui.label]] = {}
        super().__init__(view)

    def _visible_jobs(self) -> list[Job]:
        return [job for job in self.desk.jobs.all if not job.over or job.state in (FAILED, CANCELLED)]

    def state(self) -> Any:
        return tuple((id(job), job.state) for job in self._visible_jobs())

    def draw(self) -> None:
        self._bars = {}
        jobs = self._visible_jobs()
        if not jobs:
            note("Nothing runs.")
        for job in jobs:
            with ui.row().classes("w-full items-center no-wrap gap-2").props("data-mark=job"):
                with ui.column().classes("grow gap-0 min-w-0"):
                    ui.label(job.title).classes("text-body2 break-words")
                    if job.state == FAILED:
                        note(job.error, "text-negative")
                    elif job.state == CANCELLED:
                        note("cancelled")
                    else:
                        bar = ui.linear_progress(value=job.share, show_value=False).props("rounded")
                        words = ui.label("").classes("text-caption text-grey-8 break-words")
                        self._bars[job] = bar, words
                if job.over:
                    ui.button(icon="close", on_click=lambda job=job: self.desk.jobs.forget(job)).props(
                        "flat dense round"
                    ).tooltip("Take it off the list")
                else:
                    ui.button("Cancel", on_click=lambda job=job: self.desk.jobs.cancel(job)).props(
                        "outline dense"
                    ).classes("q-px-sm").props("data-mark=cancel")

    def refresh(self) -> None:
        super().refresh()
        for job, (bar, words) in self._bars.items():
            bar.set_value(round(job.share, 3))
            words.set_text(f"{job.seconds:.0f} s, {job.progress}")
