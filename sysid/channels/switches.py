"""The column that says when a drive is on."""

from collections.abc import Sequence

import numpy as np

from sysid.channels.column import Column, Header, parse_header, words
from sysid.channels.complaints import list_names
from sysid.channels.roles import SWITCH, Columns

_DRIVE = words("torque motor drive driver servo axis joint actuator power output is state status")  # beside the switch
NO_SWITCH = 'if it says something else, write drive = "" under [range] in a mapping, which uses every row'


def is_switch(header: Header) -> bool:
    """Whether the name of a column says that it tells when the drive is on."""
    return header.has(SWITCH) and header.words <= SWITCH | _DRIVE


def switch_of(columns: Columns, names: Sequence[str]) -> tuple[Column | None, str]:
    """The column that says when the drive is on, 0 and another value, if it is one; and what was made of its kind.

    `names` are those of all columns, also of text.
    """
    headers = {name: columns[name].header if name in columns else parse_header(name) for name in names}
    likely = [name for name, header in headers.items() if is_switch(header)]
    likely = [
        name for name in likely if name not in columns or not columns[name].finite.all() or not columns[name].constant
    ]
    if not likely:
        return None, ""
    name, column = likely[0], columns.get(likely[0])
    levels = np.unique(column.finite) if column is not None else np.zeros(0)
    if len(likely) > 1:
        reason = f"so may {list_names(likely[1:])}"
    elif column is None:
        reason = "it holds text"
    elif headers[name].has({"disable", "disabled"}):
        reason = "its name says that it is 0 then"
    elif len(levels) != 2 or levels[0] != 0.0:
        shown = f"{len(levels)} values" if len(levels) > 2 else " and ".join(f"{level:g}" for level in levels)
        reason = f"it holds {shown}"
    else:
        return column, f"column {name!r} is 0 while the drive is off: what lies between is left out ({NO_SWITCH})"
    return None, (
        f"column {name!r} may say when the drive is on, but {reason}: nothing is left out. If the drive was off, "
        "name a column that is 0 there and 1 elsewhere as drive of [range] in a mapping"
    )
