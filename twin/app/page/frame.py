"""The page as a whole, and the routes of the files that it offers."""

from functools import partial
from typing import Any

from fastapi import FastAPI
from fastapi.responses import PlainTextResponse, Response
from nicegui import app, ui

from sysid.base.errors import InputError
from sysid.base.quantities import capital
from sysid.report.page import POLICY
from twin.app.desk import Desk
from twin.app.page.answer import AnswerPanel
from twin.app.page.fit import FitPanel, JobsPanel
from twin.app.page.panel import View, attempt, note
from twin.app.page.record import AdvicePanel, DataPanel, PreparePanel, SignalsPanel
from twin.app.page.results import BoardPanel, DetailPanel, rank
from twin.app.page.rig_live import LivePanel, StopBar
from twin.app.page.rig_panel import RigPanel
from twin.app.page.twin_panel import LegPanel, StudyPanel

LOOK = 0.4  # [s] between looks for changes
PATIENCE = 30.0  # [s] that a busy machine may take to answer before the page starts afresh
WORK, RIG = "Logs and models", "Rig"  # the two pages
STYLE = """
body { background: #eef2f5; }
.qpal-page { display: grid; gap: 12px; grid-template-columns: minmax(0, 1fr); }
@media (min-width: 1024px) { .qpal-page { grid-template-columns: 360px minmax(0, 1fr); align-items: start; } }
.q-uploader__subtitle { display: none; }
.q-uploader__list { min-height: 44px; padding: 0; }
@media (max-width: 700px) { .modebar-container { display: none; } }
.qpal-file { border: 1px solid #2f6f8f; border-radius: 16px; padding: 3px 12px; color: #2f6f8f; font-size: 14px; }
.qpal-file { text-decoration: none; }
.qpal-file:hover { background: #dbe7ee; }
.qpal-download::before { content: "\\2193\\00a0"; }
.qpal-open::before { content: "\\2197\\00a0"; }
.qpal-tabs .q-tabs__content { flex-wrap: wrap; }
@media (max-width: 1023px) { .qpal-first { order: -1; } }
@media (max-width: 700px) { .qpal-wide { display: none; } }
@media (min-width: 701px) { .qpal-narrow { display: none; } }
.qpal-table { border-collapse: collapse; width: 100%; font-size: 14px; }
.qpal-table th, .qpal-table td { padding: 2px 8px; border-bottom: 1px solid #e4e7eb; white-space: nowrap; }
@media (max-width: 700px) {
  .qpal-table td { white-space: normal; }
  .qpal-table .q-btn__content { text-align: left; justify-content: start; }
  .qpal-table :is(th, td):is(:nth-child(3), :nth-child(4), :nth-child(6), :nth-child(7)) { display: none; }
}
.qpal-table th { color: #52606d; font-weight: 600; }
.qpal-good { --word: #2f855a; }
.qpal-usable { --word: #b7791f; }
.qpal-poor { --word: #c53030; }
.qpal-answer { grid-column: 1 / -1; }
.qpal-answer-box { display: grid; gap: 12px 32px; grid-template-columns: minmax(0, 1fr); }
@media (min-width: 1024px) {
  .qpal-answer-box { grid-template-columns: minmax(0, 3fr) minmax(0, 2fr); align-items: center; }
}
.qpal-verdict { border-left: 8px solid var(--word, #52606d); padding: 2px 0 2px 16px; width: 100%; }
.qpal-number { display: flex; flex-wrap: wrap; align-items: center; gap: 0 14px; line-height: 1.15; }
.qpal-number { font-size: clamp(34px, 9.4vw, 46px); font-weight: 650; }
.qpal-word { color: var(--word); }
.qpal-mark { display: inline-block; flex: none; width: .62em; height: .62em; }
.qpal-mark { background: var(--word); border-radius: 50%; }
.qpal-mark.qpal-usable { background: linear-gradient(90deg, var(--word) 50%, transparent 50%); }
.qpal-mark.qpal-usable { border: .09em solid var(--word); }
.qpal-mark.qpal-poor { border-radius: 0; clip-path: polygon(50% 0, 100% 100%, 0 100%); }
.qpal-step .q-btn__content { text-align: left; flex-wrap: nowrap; }
"""
TYPES = {".html": "text/html", ".json": "application/json", ".xml": "application/xml"}
# A report has scripts and comes from a session that another person may have made: it runs apart, and fetches nothing.
APART = {"Content-Security-Policy": f"sandbox allow-scripts allow-downloads; {POLICY}; script-src 'unsafe-inline'"}


def application(desk: Desk) -> FastAPI:
    """The page of `desk` as an application; to be served behind the guard of `twin.app.server` only."""
    api = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)

    @app.get("/files/{kind}/{key}/{name}")
    def file(kind: str, key: str, name: str) -> Response:
        try:
            content = desk.content(kind, key, name)
        except (InputError, OSError) as error:
            return PlainTextResponse(f"{error}\n", status_code=404)
        suffix = f".{name.rpartition('.')[2]}"
        headers = dict(APART)
        if suffix != ".html":
            headers["Content-Disposition"] = f'attachment; filename="{key}-{name}"'
        return Response(content, media_type=TYPES.get(suffix, "text/plain"), headers=headers)

    @ui.page("/")
    def page() -> None:
        _page(desk)

    ui.run_with(
        api, title="qpal app", language="en-US", favicon="🦿", show_welcome_message=False, reconnect_timeout=PATIENCE
    )
    return api


def _page(desk: Desk) -> None:
    """Draw the page in one browser window, and look for changes from then on."""
    ui.add_css(STYLE)
    ui.colors(primary="#2f6f8f", secondary="#7a8794", accent="#c2410c")
    view = View(desk)
    with ui.header().classes("items-center q-py-sm gap-3"):
        ui.label("qpal app").classes("text-h6")
        ui.label(f"session {desk.session.folder.name}").classes("text-caption ellipsis min-w-0").tooltip(
            str(desk.session.folder)
        )
        _undo_button(view)
        with ui.tabs().props("dense no-caps shrink").classes("q-ml-auto") as tabs:
            for name in (WORK, RIG):
                ui.tab(name).props(f'data-mark="page-{name}"').classes("q-px-sm")
        tabs.set_value(WORK)
        # what was drawn while its page was hidden takes the width that it has now
        tabs.on_value_change(lambda: ui.run_javascript("setTimeout(() => dispatchEvent(new Event('resize')), 50)"))
    StopBar(view)
    with ui.element("div").classes("qpal-page w-full q-pa-sm").bind_visibility_from(tabs, "value", value=WORK):
        panels: list[Any] = [AnswerPanel(view)]
        with ui.column().classes("w-full gap-3 min-w-0"):
            for complaint in desk.session.complaints:
                note(f"{capital(complaint)}.", "text-negative")
            panels += [DataPanel(view), PreparePanel(view), FitPanel(view), StudyPanel(view)]
        with ui.column().classes("w-full gap-3 min-w-0"):
            panels += [JobsPanel(view), SignalsPanel(view), AdvicePanel(view), BoardPanel(view)]
            panels += [DetailPanel(view), LegPanel(view)]
    with ui.element("div").classes("qpal-page w-full q-pa-sm").bind_visibility_from(tabs, "value", value=RIG):
        panels += [RigPanel(view, partial(tabs.set_value, WORK)), LivePanel(view)]

    def look() -> None:
        _show_new(view)
        for panel in panels:
            panel.refresh()

    look()
    ui.timer(LOOK, look)


def _undo_button(view: View) -> None:
    """Draw the button that takes the last change back, and says which one that is."""
    history = view.desk.history

    def undo() -> None:
        if words := attempt(history.undo):
            ui.notify(f"Undone: {words}.", position="top")

    with ui.button(icon="undo", on_click=undo).props("flat dense round color=white data-mark=undo") as button:
        words = ui.tooltip("")

    def refresh() -> None:
        button.set_enabled(bool(history.last))
        words.set_text(f"Undo {history.last}" if history.last else "Nothing to undo")

    refresh()
    ui.timer(LOOK, refresh)


def _show_new(view: View) -> None:
    """What has just been fitted is laid over the others and shown; of several models the best, as on opening."""
    models = view.desk.session.models
    studies = view.desk.session.studies
    if view.known is None:
        new, view.overlaid = [*models], {*models}
    else:
        new = [key for key in (*models, *studies) if key not in view.known]
        view.overlaid.update(key for key in new if key in models)
    if new:
        fits = [key for key in new if key in models]
        view.detail = ("models", max(fits, key=lambda key: rank(models[key]))) if fits else ("studies", new[-1])
    view.known = {*models, *studies}
    view.overlaid &= view.known
