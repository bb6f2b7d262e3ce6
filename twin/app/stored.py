"""Figures and reports that lie in a session, which a stranger may have written: what they may hold, and nothing else.

A figure is drawn by plotly, which fetches pictures, maps and styles from any address, and a report is a page. Both are
built again from the parts that `sysid.report.page` writes: known traces and settings, known elements and attributes.
The Content-Security-Policy of the server and of the page are a second wall; they stop neither a page that leads itself
elsewhere nor a connection that is opened ahead of a link.
"""

import json
import re
from html import escape
from html.parser import HTMLParser
from typing import Any

from sysid.base.errors import InputError
from sysid.report import page

NAME = re.compile(r"[a-z0-9_-]{1,40}")  # it becomes a mark of an element
TRACES = ("scatter", "bar")  # of every figure of `twin.app.figures`; maps and pictures fetch
LAYOUT = re.compile(
    r"height|margin|font|title|(paper|plot)_bgcolor|legend|showlegend|hoverlabel|hovermode|hoversubplots|annotations|"
    r"shapes|uirevision|bargap|barmode|updatemenus|dragmode|meta|[xy]axis\d{0,2}"
)
# Names under which plotly looks for an address, also inside the name of a button's change: "images[0].source".
FETCHED = frozenset(["source", "src", "href", "layers", "images", "template", "style"])
MOST_PANELS = 9
LINK = re.compile(r"<(?=\s*/?a\b)", re.IGNORECASE)  # the only element of plotly's texts that leads elsewhere
TAGS = re.compile(  # of template.html
    "main|h1|h2|p|div|nav|a|section|table|caption|thead|tbody|tr|th|td|figure|img|figcaption|details|summary|pre|code|"
    "span|abbr|dl|dt|dd|footer"
)
SHOWN = ("class", "id", "title", "alt", "tabindex", "aria-sort")
VALUES = {  # attributes with the values that do nothing but show
    "src": re.compile(r"data:image/png;base64,[A-Za-z0-9+/=]*"),
    "href": re.compile(r"#[^\s]*"),
    "style": re.compile(r"height:\d{1,4}px"),
}


def figures(content: bytes) -> dict[str, Any]:
    """The figures of a session's file, each with its caption. Raises ValueError for what `twin.app.figures` does not
    write."""
    entries = json.loads(content)
    _demand(isinstance(entries, dict))
    for name, entry in entries.items():
        _demand(NAME.fullmatch(name) is not None and isinstance(entry, dict) and {"figure", "caption"} == set(entry))
        _demand(isinstance(entry["caption"], str))
        entry["figure"] = figure(entry["figure"])
    return entries


def figure(content: Any) -> dict[str, Any]:
    """A figure without addresses; raises ValueError for traces or settings that no figure here has."""
    _demand(isinstance(content, dict) and {"data", "layout"} <= set(content))
    traces, layout = content["data"], content["layout"]
    _demand(isinstance(traces, list) and isinstance(layout, dict))
    _demand(all(isinstance(trace, dict) and trace.get("type") in TRACES for trace in traces))
    _demand(all(LAYOUT.fullmatch(name) for name in layout))
    _demand(all(isinstance(layout.get(name, []), list) for name in ("annotations", "shapes", "updatemenus")))
    menus = layout.get("updatemenus", [])
    _demand(all(isinstance(menu, dict) and isinstance(menu.get("buttons"), list) for menu in menus))
    buttons = [button for menu in menus for button in menu["buttons"]]
    _demand(all(isinstance(button, dict) and button.get("method") == "relayout" for button in buttons))
    _demand(isinstance(layout.get("height"), int) and 0 < layout["height"] <= 10000)
    _demand(isinstance(layout.get("legend", {}), dict) and isinstance(layout.get("meta", {}), dict))
    beside = layout.get("meta", {}).get("beside", 1)
    _demand(isinstance(beside, int) and 1 <= beside <= MOST_PANELS)
    if beside > 1:  # `figures.stack_panels` moves these
        axes = [layout.get(f"{letter}axis{k or ''}") for letter in "xy" for k in (0, *range(2, beside + 1))]
        _demand(all(isinstance(part, dict) for part in (*axes, *layout.get("annotations", []))))
        _demand(len(layout.get("annotations", [])) >= beside)
        _demand(isinstance(layout.get("legend", {}).get("y"), int | float))
    return {"data": _without_addresses(traces), "layout": _without_addresses(layout)}


def _demand(holds: bool) -> None:
    if not holds:
        raise ValueError


def _without_addresses(value: Any) -> Any:
    if isinstance(value, dict):
        _demand(not any(set(re.split(r"[.\[\]]+", name)) & FETCHED for name in value))
        return {name: _without_addresses(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_without_addresses(entry) for entry in value]
    return LINK.sub("&lt;", value) if isinstance(value, str) else value


def report(content: bytes) -> bytes:
    """A report built again from its elements, pictures and figures, with the style and the scripts of this qpal.

    Raises InputError for a page in which there is no report.
    """
    reader = _Reader()
    try:
        reader.feed(content.decode("utf-8"))
        reader.close()
    except (ValueError, RecursionError, AssertionError):
        reader.parts.clear()
    if not reader.parts:
        raise InputError("the report is damaged; fit or compare again")
    return page.rebuilt(reader.title, "".join(reader.parts), reader.draws).encode()


class _Reader(HTMLParser):
    """Collects the elements of a report that `TAGS` has, escaped anew; everything else is left out."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.parts: list[str] = []
        self.open: list[str] = []
        self.title, self.draws = "", False
        self._text: list[str] | None = None  # of a title, a style or a script, which are not shown
        self._figure: str | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        if tag in ("title", "style", "script"):
            self._text = []
            self._figure = values.get("data-for") if values.get("type") == "application/json" else None
        elif TAGS.fullmatch(tag) and (self.open or tag == "main"):
            kept = {name: value for name, value in values.items() if _only_shows(name, value)}
            attributes = "".join(f' {name}="{escape(value)}"' for name, value in kept.items())
            self.parts.append(f"<{tag}{attributes}>")
            if tag != "img":
                self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in ("title", "style", "script") and self._text is not None:
            text, self._text = "".join(self._text), None
            if tag == "title":
                self.title = text
            elif tag == "script" and self._figure is not None and self.open:
                self.parts.append(page.figure_script(figure(json.loads(text)), self._figure))
                self.draws = True
        elif tag in self.open:
            while (last := self.open.pop()) != tag:
                self.parts.append(f"</{last}>")
            self.parts.append(f"</{tag}>")

    def handle_data(self, data: str) -> None:
        if self._text is not None:
            self._text.append(data)
        elif self.open:
            self.parts.append(escape(data))


def _only_shows(name: str, value: str) -> bool:
    return name in SHOWN or (name in VALUES and VALUES[name].fullmatch(value) is not None)
