"""The table of verbs."""

import shlex
from functools import cache
from typing import Annotated, Any

import typer
from typer.core import TyperArgument, TyperGroup

from sysid.base.errors import InputError
from twin.cli import bench, rig
from twin.cli.browser import app as browser
from twin.cli.calibrate import calibrate
from twin.cli.compare import compare
from twin.cli.crawl import crawl
from twin.cli.demo import demo
from twin.cli.design import design
from twin.cli.export import export
from twin.cli.identify import identify
from twin.cli.info import info
from twin.cli.options import Verb
from twin.cli.reproduce import reproduce
from twin.cli.run import run
from twin.cli.simulate import simulate
from twin.cli.view import view

VERBS = (demo, info, identify, run, export, design, browser, simulate, compare, calibrate, view, crawl, reproduce)
# As `qpal --help` shows them; rig and bench have verbs of their own.
HEADINGS = {
    "Begin": ("demo",),
    "Models of records": ("info", "identify", "run", "export", "design", "app"),
    "The leg and its rig": ("simulate", "compare", "calibrate", "view", "rig"),
    "For work on QPAL itself": ("reproduce", "crawl", "bench"),
}
RENAMED = {"models": "run"}
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


def _certificate(asked: bool) -> None:
    if asked:
        from sysid.bench.certificate.release import page_file

        if (file := page_file()) is None:
            raise InputError("no certificate lies with this copy of QPAL; qpal bench certify --page FILE.md makes one")
        print(file.read_text(encoding="utf-8"), end="")
        raise typer.Exit


def qpal_options(
    version: Annotated[
        bool, typer.Option("--version", help="print the version and end", callback=_version, is_eager=True)
    ] = False,
    certificate: Annotated[
        bool,
        typer.Option(
            "--certificate", help="print the certificate and end", hidden=True, callback=_certificate, is_eager=True
        ),
    ] = False,
) -> None:
    """Models of dynamic systems from logs, with intervals; and the digital twin of a leg that they are checked on."""


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


class _Verbs(TyperGroup):
    """The verbs under their headings; an old name of one is told what it is called now."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for heading, names in HEADINGS.items():
            with formatter.section(heading):
                formatter.write_dl([(name, self.commands[name].get_short_help_str(80)) for name in names])

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and (now := RENAMED.get(args[0])):
            raise InputError(f"qpal {args[0]} is called qpal {now} now: {shlex.join(['qpal', now, *args[1:]])}")
        return super().resolve_command(ctx, args)


def build() -> typer.Typer:
    """The command line with every verb."""
    app = typer.Typer(
        name="qpal",
        cls=_Verbs,
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
