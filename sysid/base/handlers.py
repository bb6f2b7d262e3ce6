"""What a class does with rooms above its own: `data.plot()` needs the figures, `fit.report()` the page.

A record lies on a low floor and imports nothing from above. It asks here for the module of `sysid.notebook` that
belongs to its class, and that room is the only one that is found so: it lies on the top floor, and no room imports it.
"""

from importlib import import_module
from typing import Any

ROOM = "sysid.notebook"
MODULES = {
    "IOData": "record",
    "Fit": "fit",
    "NlarxFit": "nlarx_fit",
    "Growth": "growth",
    "Selection": "selection",
    "Comparison": "comparison",
    "ResidualTests": "residual_tests",
    "Modes": "modes",
}


def handler(thing: Any) -> Any:
    """The module of `sysid.notebook` for the class of `thing`, or for the class that it derives from."""
    for kind in type(thing).__mro__:
        if kind.__name__ in MODULES:
            return import_module(f"{ROOM}.{MODULES[kind.__name__]}")
    raise TypeError(f"sysid.notebook has no module for {type(thing).__name__}")


class Shown:
    """A result that shows itself: a line as `repr`, one screen as `str`, and the same screen in a notebook."""

    def __repr__(self) -> str:
        return str(handler(self).line(self))

    def __str__(self) -> str:
        return str(handler(self).card(self).text())

    def _repr_html_(self) -> str:
        return str(handler(self).card(self).html())
