"""A zoomable figure inside a page: its data beside an empty element, and one script that draws all of them."""

import base64
import json
from importlib import resources
from typing import Any

import numpy as np

Figure = dict[str, Any]  # of plotly: {"data": [...], "layout": {...}}, and "frames" of a figure that moves
PACKED = 64  # numbers; a longer list travels as the bytes of its doubles, which are exact and half as long


def element(figure: Figure, name: str) -> str:
    """The HTML of a figure: a box of its height, named `name`, that `DRAW` fills; nothing is drawn without scripts.

    Raises ValueError for a number that JSON has not.
    """
    text = json.dumps(_packed(figure), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    safe = text.replace("<", "\\u003c").replace("&", "\\u0026")  # no text of a figure ends the script or opens a tag
    height = int(figure["layout"].get("height", 400))
    return (
        f'<div class="zoom" id="zoom-{name}" style="height:{height}px"></div>'
        f'<script type="application/json" data-for="zoom-{name}">{safe}</script>'
    )


def script() -> str:
    """The text of plotly.js, about 5 MB, for a page that stands alone."""
    from plotly import offline

    return str(offline.get_plotlyjs())


def _packed(value: Any) -> Any:
    """A figure as JSON values, long lists of numbers as base64."""
    if isinstance(value, dict):
        return {key: _packed(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        if len(value) > PACKED and all(each is None or isinstance(each, int | float) for each in value):
            doubles = np.array([np.nan if each is None else each for each in value], dtype="<f8")
            return {"dtype": "f8", "bdata": base64.b64encode(doubles.tobytes()).decode("ascii")}
        return [_packed(each) for each in value]
    if isinstance(value, np.generic):
        return _packed(value.item())
    return None if isinstance(value, float) and not np.isfinite(value) else value


DRAW = resources.files("sysid.report").joinpath("zoom.js").read_text(encoding="utf-8")
