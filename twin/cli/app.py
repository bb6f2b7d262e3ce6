"""The table of verbs."""

from functools import cache
from typing import Annotated, Any

import typer
from typer.core import TyperArgument

from twin.cli import bench, rig
from twin.cli.browser import app as browser
from twin.cli.calibrate import calibrate
from twin.cli.compare import compare
from twin.cli.crawl import crawl
from twin.cli.design import design
from twin.cli.export import export
from twin.cli.identify import identify
from twin.cli.info import info
from twin.cli.models import models
from twin.cli.options import Verb
from twin.cli.reproduce import reproduce
from twin.cli.run import run
from twin.cli.simulate import simulate
from twin.cli.view import view

VERBS = (reproduce, simulate, identify, compare, calibrate, design, info, view, crawl, run, models, export, browser)
# What these make is looked at: they write no report and no summary, and take no --out and --json.
SHOWN = (view, browser)


def _version(asked: bool) -> None:
    if asked:
        from importlib import metadata

        try:
            print("qpal", metadata.version("qpal"))
        except metadata.PackageNotFoundError:
            print("qpal, run from its folder without being installed: no version")
        raise typer.Exit


def qpal_options(
    version: Annotated[
        bool, typer.Option("--version", help="print the version and end", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """Digital twin of a robot leg, and system identification that is checked against it."""


class _Verb(Verb):
    """A verb whose help shows its arguments by name alone, without their Python types."""

    def get_params(self, ctx: Any) -> list[Any]:
        parameters = super().get_params(ctx)
        for argument in parameters:
            if isinstance(argument, TyperArgument):
                vars(argument)["display_type_rich"] = lambda ctx: None
        return parameters

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        return [
            piece.replace("...}...", "...}").replace("FILE}...", "FILE}") for piece in super().collect_usage_pieces(ctx)
        ]


def build() -> typer.Typer:
    """The command line with every verb."""
    app = typer.Typer(
        name="qpal",
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
        rich_markup_mode=None,  # help is shown as it is written: rich takes words in brackets for its own marks
    )
    app.callback()(qpal_options)
    for verb in VERBS:
        app.command(cls=_Verb)(verb)
    app.add_typer(rig.build())
    app.add_typer(bench.build())
    return app


@cache
def command_line(named_shell: bool) -> Any:
    """The command line built, once in a process for each answer to whether `_named_shell` of `twin.cli` acts."""
    return typer.main.get_command(build())
