"""What to say where a log has no column for the input or the output: choices, or that there is nothing to choose."""

from collections.abc import Mapping

from sysid.channels.complaints import listed
from sysid.channels.looks import Look
from sysid.channels.unread import unread
from sysid.data.table import Table

ROLES = ("input", "output")


def lacking(
    table: Table, picked: Mapping[str, Look | None], columns: Mapping[str, Look], rest: Mapping[str, Look]
) -> list[str]:
    """The sentence about the roles that `picked` leaves open, none if it leaves none open.

    `columns` are all that hold numbers; `rest` are those that do not show time. Naming one that never moves
    leads nowhere, so the sentence asks for a column only where enough of them move.
    """
    missing = [role for role in ROLES if picked[role] is None]
    if not missing:
        return []
    for role, look in picked.items():
        if look is not None and look.constant:
            return [_never_moves(role, look)]
    if said := unread(table, columns):
        return [said]
    free = [look for look in rest.values() if not any(look is each for each in picked.values())]
    still = [look for look in free if look.constant]
    found = f"found {len(table.names)} column{'s' if len(table.names) > 1 else ''} ({listed(table.names)})"
    which = f"; {' and '.join(look.name for look in still)} never {'changes' if len(still) == 1 else 'change'}"
    which = which if still else ""
    if len(free) - len(still) >= len(missing):
        wanted = " and one with ".join(f"--{role}" for role in missing)
        return [f"{found}{which}; name one with {wanted}, or in the mapping file of --map"]
    clocks = [name for name in columns if name not in rest]
    clock = f", of which {' and '.join(clocks)} show{'s' if len(clocks) == 1 else ''} time" if clocks else ""
    out = "".join(f"; {note}" for note in table.notes if note.startswith("left out what"))
    if still:
        remedy = "choose columns that move, or record again while it moves"
        if len(still) == 1 and len(missing) == 1:
            remedy = f"record again while the {missing[0]} moves, or give a log that has it"
        return [
            f"{found}{clock}{which}, and no column that moves is left for the {' and the '.join(missing)}; {remedy}"
        ]
    return [
        f"{found}{clock}{out}: no column is left for the {' and the '.join(missing)}; give a log that has an input "
        "and an output, recorded together"
    ]


def _never_moves(role: str, look: Look) -> str:
    """The sentence about a column that has one value."""
    value = f"{look.finite[0]:g}" if len(look.finite) else "empty"
    return f"the {role} {look.name!r} is {value} in all {len(look.values)} samples; choose a column that moves"
