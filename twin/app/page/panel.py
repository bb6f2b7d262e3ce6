"""A part of the page that draws itself again when what it shows has changed."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from nicegui import ui

from sysid.base.errors import InputError
from sysid.base.quantities import capital
from sysid.data.record import IOData
from twin.app.desk import Desk
from twin.app.entries import Data


@dataclass
class View:
    """What one browser window looks at: a record, the models in the overlay, and the model or study in the tabs."""

    desk: Desk
    overlaid: set[str] = field(default_factory=set)
    known: set[str] | None = None  # models and studies that this window has seen; None before it has looked
    detail: tuple[str, str] | None = None  # ("models" or "studies", id)
    tab: str = ""
    moves: bool = False  # whether this window has begun what the rig does now

    @property
    def key(self) -> str | None:
        """The record that is shown."""
        key = self.desk.session.head.shown
        return key if key in self.desk.session.data else next(reversed(self.desk.session.data), None)


class Panel:
    """A card with a title; `state` is everything that `draw` depends on."""

    title = ""

    def __init__(self, view: View) -> None:
        self.view = view
        self.desk = view.desk
        self._seen: Any = self  # equal to no state
        with ui.card().classes("w-full gap-2 q-pa-md shadow-1") as self.card:
            if self.title:
                ui.label(self.title).classes("text-h6 text-primary")
            self.box = ui.column().classes("w-full gap-2")
            self.foot()

    def state(self) -> Any:
        """Equal values mean that nothing has to be drawn again."""
        raise NotImplementedError

    def draw(self) -> None:
        """Draw the inside of the card."""
        raise NotImplementedError

    def foot(self) -> None:
        """Draw what stays below it, once."""

    def refresh(self) -> None:
        """Draw again if something has changed."""
        state = self.state()
        if state != self._seen:
            self._seen = state
            self.box.clear()
            with self.box:
                attempt(self.draw)


class RecordPanel(Panel):
    """A panel about the shown record: `fields` of its entry are its state, `empty` is said where there is no record."""

    fields: tuple[str, ...] = ()
    empty = ""

    def state(self) -> Any:
        key = self.view.key
        return None if key is None else (key, *(getattr(self.desk.session.data[key], name) for name in self.fields))

    def draw(self) -> None:
        key = self.view.key
        if key is not None:
            self.draw_record(key, self.desk.session.data[key])
        elif self.empty:
            note(self.empty)

    def draw_record(self, key: str, entry: Data) -> None:
        """Draw what there is about a record."""
        raise NotImplementedError

    def samples(self, key: str) -> IOData | None:
        """The record as it was read; None, and a note says why, where it was not."""
        try:
            return self.desk.record(key)
        except InputError as error:
            note(str(error))
            return None


def attempt(action: Callable[[], Any]) -> Any:
    """The action's result; bad input becomes a message on the page."""
    try:
        return action()
    except InputError as error:
        tell(str(error))
        return None


def tell(sentence: str) -> None:
    """A message that stays until it is closed."""
    text = capital(sentence)
    ui.notify(text, type="warning", multi_line=True, close_button="OK", timeout=12000, position="top")


def delete_button(action: Callable[[], Any], meaning: str) -> None:
    """A small button that deletes."""
    ui.button(icon="delete", on_click=action).props("flat dense round size=sm").tooltip(meaning)


def note(text: str, tone: str = "text-grey-8") -> None:
    """A sentence in small letters."""
    ui.label(text).classes(f"text-caption {tone} whitespace-normal break-words")
