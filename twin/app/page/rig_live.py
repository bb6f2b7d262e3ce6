"""What a rig does while it moves: the stop button at the foot of each window, and the live figure."""

from typing import Any

from nicegui import ui

from twin.app.page.panel import Panel, View, note
from twin.app.rig import MOVING
from twin.app.rig_figure import live

BEAT = 0.2  # [s] between two looks at what moves
CLOSED = "the page that moved it was closed"
DOING = {"wire": "checking the wiring", "zero": "finding the ends", "run": "playing the input"}
# Escape and the space bar are the stop button, wherever the focus is; the focus goes, so that a button that has it is
# not pressed when the key comes up.
KEYS = """
<script>
document.addEventListener("keydown", event => {
  const button = document.querySelector('[data-mark="rig-stop"]');
  if (!button || button.offsetParent === null || !["Escape", " "].includes(event.key)) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  if (document.activeElement) document.activeElement.blur();
  button.click();
}, true);
</script>
"""


class StopBar:
    """The stop button at the foot of the window, in every window, while a drive may be on.

    The window that has begun a movement sends beats while the browser answers, and its end is a stop.
    """

    def __init__(self, view: View) -> None:
        self.view, self.rig = view, view.desk.rig
        ui.add_body_html(KEYS)
        self._bar = ui.footer(value=False).classes("q-pa-sm bg-white")
        with self._bar, ui.column().classes("w-full gap-1") as self._inside:
            self._words = ui.label("").classes("text-caption text-grey-9 break-words").props("data-mark=rig-moves")
            ui.button("Stop: drive off", icon="dangerous", on_click=lambda: self.rig.stop()).props(
                'color=negative size=lg data-mark=rig-stop aria-label="Stop: drive off"'
            ).classes("w-full text-weight-bold")
        self._inside.set_visibility(False)
        ui.on("qpal_rig_beat", self._answer)
        ui.context.client.on_disconnect(self._closed)
        ui.timer(BEAT, self._look)

    def _look(self) -> None:
        """Show the button, and ask the browser for a sign of life."""
        rig = self.rig
        if self._bar.value != rig.driving:
            self._bar.set_value(rig.driving)
            self._inside.set_visibility(rig.driving)  # a bar that is hidden still has a button, which keys would press
        if not rig.driving:
            if rig.state != MOVING:
                self.view.moves = False
            return
        t, plan = rig.seen.rows[-1][0] if rig.seen.rows else 0.0, rig.seen.plan
        whole = f" of {len(plan.u) * plan.Ts:.1f}" if plan else ""
        self._words.set_text(f"The rig moves: {DOING[rig.doing]}, {t:.1f}{whole} s. Esc and space stop it too.")
        if self.view.moves:
            ui.run_javascript("emitEvent('qpal_rig_beat')")

    def _answer(self) -> None:
        if self.view.moves:
            self.rig.beat()

    def _closed(self) -> None:
        if self.view.moves and self.rig.driving:
            self.rig.stop(CLOSED)


class LivePanel(Panel):
    """What the rig does, drawn five times a second while it moves."""

    title = "Live"

    def __init__(self, view: View) -> None:
        self.rig = view.desk.rig
        self._plot: ui.plotly | None = None
        self._drawn: Any = None
        super().__init__(view)
        self.card.classes("qpal-first")
        ui.timer(BEAT, self._redraw)

    def state(self) -> Any:
        return self.rig.port is not None or bool(self.rig.seen.rows)

    def draw(self) -> None:
        self._plot, self._drawn = None, None
        self.card.set_visibility(bool(self.state()))
        if self.state():
            self._plot = (
                ui.plotly({"data": [], "layout": {"height": 560}}).classes("w-full").props("data-mark=rig-live")
            )
            note("The last 20 s of the joint that moves. The supply is in per cent of that at the beginning.")

    def _redraw(self) -> None:
        state = self.rig.seen, len(self.rig.seen.rows)
        if self._plot is not None and state != self._drawn:
            self._drawn = state
            self._plot.update_figure(live(state[0], self.rig.port.full if self.rig.port else 0))
