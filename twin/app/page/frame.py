"""The page as a whole, and the routes of the files that it offers."""

from functools import partial

from fastapi import FastAPI
from fastapi.responses import PlainTextResponse, Response
from nicegui import app, ui

from sysid.base.errors import InputError
from sysid.base.quantities import capital
from sysid.report.page import POLICY
from twin.app.desk import Desk
from twin.app.page.fit import FitPanel, JobsPanel
from twin.app.page.panel import View, note
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
        with ui.tabs().props("dense no-caps shrink").classes("q-ml-auto") as tabs:
            for name in (WORK, RIG):
                ui.tab(name).props(f'data-mark="page-{name}"').classes("q-px-sm")
        tabs.set_value(WORK)
        # what was drawn while its page was hidden takes the width that it has now
        tabs.on_value_change(lambda: ui.run_javascript("setTimeout(() => dispatchEvent(new Event('resize')), 50)"))
    StopBar(view)
    with ui.element("div").classes("qpal-page w-full q-pa-sm").bind_visibility_from(tabs, "value", value=WORK):
        with ui.column().classes("w-full gap-3 min-w-0"):
            for complaint in desk.session.complaints:
                note(f"{capital(complaint)}.", "text-negative")
            panels = [DataPanel(view), PreparePanel(view), FitPanel(view), StudyPanel(view)]
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


def _show_new(view: View) -> None:
    """A model that has just been fitted is laid over the others and, if nothing is looked at, shown."""
    models = view.desk.session.models
    for key in models:
        if key not in view.known:
            view.overlaid.add(key)
    if view.detail is None and models:
        view.detail = "models", max(models, key=lambda key: rank(models[key]))
    view.known = set(models)
    view.overlaid &= view.known
