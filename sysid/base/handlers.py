"""What a class does with rooms above its own: `data.plot()` needs the figures, `fit.report()` the page.

A record lies on a low floor and imports nothing from above. It asks here for the class of `sysid.notebook` that
belongs to its own, and that room is the only one that is found so: it lies on the top floor, and no room imports it.
"""

from importlib import import_module
from typing import Any

from sysid.base.errors import readable

ROOM = "sysid.notebook"
MODULES = {
    "IOData": "results",
    "Fit": "fits",
    "NlarxFit": "fits",
    "JointFit": "results",
    "Selection": "results",
    "Comparison": "results",
    "ResidualTests": "results",
    "Modes": "results",
    "ResponseFit": "frequency",
}


def handler(thing: Any) -> Any:
    """The class of `sysid.notebook`, `FitView` for a Fit, for the class of `thing` or one that it derives from."""
    for kind in type(thing).__mro__:
        if kind.__name__ in MODULES:
            return getattr(import_module(f"{ROOM}.{MODULES[kind.__name__]}"), f"{kind.__name__}View")
    raise TypeError(f"sysid.notebook has no class for {type(thing).__name__}")


class Shown:
    """A result that shows itself: a line as `repr`, one screen as `str`, and the same screen in a notebook."""

    def __repr__(self) -> str:
        return readable(str(handler(self).line(self)))

    def __str__(self) -> str:
        return readable(str(handler(self).card(self).text()))

    def _repr_html_(self) -> str:
        return str(handler(self).card(self).html())
