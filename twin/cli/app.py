"""The table of verbs."""

import typer

from twin.cli import bench
from twin.cli.browser import app as browser
from twin.cli.calibrate import calibrate
from twin.cli.compare import compare
from twin.cli.crawl import crawl
from twin.cli.design import design
from twin.cli.export import export
from twin.cli.identify import identify
from twin.cli.info import info
from twin.cli.reproduce import reproduce
from twin.cli.simulate import simulate
from twin.cli.view import view

VERBS = (reproduce, simulate, identify, compare, calibrate, design, info, view, crawl, export, browser)
SHOWN = (
    view,
    browser,
)  # what these make is looked at: they write no report and no summary, and take no --out and --json


def build() -> typer.Typer:
    """The command line with every verb."""
    app = typer.Typer(
        name="qpal",
        help="Digital twin of a robot leg, and system identification that is checked against it.",
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,  # help is shown as it is written: rich takes words in brackets for its own marks
    )
    for verb in VERBS:
        app.command()(verb)
    app.add_typer(bench.build())
    return app
