"""`qpal simulate`: an excitation experiment on the twin."""

from typing import Annotated

import typer

from twin.cli import options


def simulate(
    joint: Annotated[str, typer.Option(metavar="NAME", help="shoulder, thigh or shank")] = "thigh",
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Run an excitation experiment on one joint of the twin and write its log."""
