"""The first screen of a result: a large number with one word and one sentence, and what to do next as a button."""

from typing import Any

from nicegui import ui

from sysid.base.quantities import capital
from twin.app.entries import AUTO, Model, Study, Verdict
from twin.app.page.panel import Panel, View, attempt, note


class AnswerPanel(Panel):
    """What the chosen model or study is worth, above all else; nothing before there is one."""

    def __init__(self, view: View) -> None:
        super().__init__(view)
        self.card.classes("qpal-answer")
        self.box.classes("qpal-answer-box")

    def state(self) -> Any:
        shown = self.view.detail
        return None if shown is None else (shown, getattr(self.desk.session, shown[0]).get(shown[1]))

    def draw(self) -> None:
        shown = self.view.detail
        entry = None if shown is None else getattr(self.desk.session, shown[0]).get(shown[1])
        self.card.set_visibility(entry is not None and bool(entry.verdict.number))
        if shown is None or entry is None:
            return
        ui.run_javascript("window.scrollTo({top: 0, behavior: 'smooth'})")  # the button of a fit is far below
        with ui.element("div").classes(f"qpal-verdict qpal-{entry.verdict.word or 'none'}").props("data-mark=verdict"):
            ui.label(f"{shown[1]}  {heading(entry)}").classes("text-body2 text-weight-bold break-words")
            _draw_verdict(entry.verdict)
        if isinstance(entry, Model):
            with ui.column().classes("w-full gap-1 min-w-0"):
                self._draw_steps(shown[1], entry)

    def _draw_steps(self, key: str, model: Model) -> None:
        """Draw what to do next: a button for what was tried, or what stands in the way."""
        for k, step in enumerate(model.steps):
            if step.setting is None:
                note(f"Next: {step.why}.", "text-body2")
                continue
            button = ui.button(f"Try: {step.words}", icon="arrow_forward")
            button.on_click(lambda step=step: attempt(lambda: self.desk.take_step(key, step)))
            button.props(f"no-caps align=left data-mark=step-{k}{' outline' if k else ''}").classes("qpal-step")
            if step.why not in model.verdict.sentence:
                note(f"{capital(step.why)}.")


def heading(entry: Model | Study) -> str:
    """A model or a study in a few words."""
    if isinstance(entry, Model):
        return f"{entry.name.replace('_', ' ')}{', chosen by a search' * (entry.asked == AUTO)}"
    return f"{entry.model} on {entry.data}" if entry.kind == "run" else f"{entry.kind} {entry.data}, {entry.joint}"


def mark(verdict: Verdict) -> None:
    """Draw the word as a shape of its own, in its colour."""
    if verdict.word:
        ui.element("span").classes(f"qpal-mark qpal-{verdict.word}").tooltip(verdict.word)


def _draw_verdict(verdict: Verdict) -> None:
    with ui.element("div").classes("qpal-number"):
        mark(verdict)
        ui.label(verdict.number)
        if verdict.word:
            ui.label(verdict.word).classes("qpal-word").props("data-mark=word")
    ui.label(capital(verdict.of)).classes("text-caption text-grey-8")
    ui.label(verdict.sentence).classes("text-body1 break-words")
