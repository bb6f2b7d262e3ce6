"""`qpal reproduce`: the paper's protocol on the three joints of the twin."""

from typing import Annotated

import typer

from twin.cli import options


def reproduce(
    seed: Annotated[int, typer.Option(metavar="N", help="of the twin's noise")] = 0,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Run the paper's protocol on the three joints and compare with the paper and with truth."""
