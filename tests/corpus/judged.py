"""What the product makes of a log of the corpus, in one word."""

from pathlib import Path

import numpy as np

from corpus._log import Log, Refused, Right
from corpus.remedies import dead_end, first, said
from sysid.base.errors import InputError
from sysid.workflow.record import read_record

WORDS = ("right", "refused", "dead end", "wrong")


def written(entry: Log, folder: Path) -> Path:
    """The file of the log, and those beside it, in the folder."""
    for name, content in {**entry.beside, entry.file: entry.content}.items():
        (folder / name).write_bytes(content)
    return folder / entry.file


def difference(found: object, right: Right) -> str:
    """In which number a record differs from the right one; nothing if in none."""
    if not np.isclose(found.Ts, right.Ts, rtol=1e-6, atol=0.0):  # type: ignore[attr-defined]
        return f"Ts is {found.Ts}, not {right.Ts}"  # type: ignore[attr-defined]
    for name in ("u", "y"):
        values, known = getattr(found, name), np.array(getattr(right, name))[:, None]
        if values.shape != known.shape or not np.allclose(values, known, rtol=1e-9, atol=1e-12):
            return f"{name} differs: {values[:3].ravel()}, not {known[:3].ravel()}"
    return ""


def judge(entry: Log, folder: Path) -> tuple[str, str]:
    """One of `WORDS`, and what was said or found: "right" are the right numbers, "refused" is a sentence whose way
    works, and "wrong" are other numbers, numbers for a file that says two things, or an error that is no sentence.
    """
    try:
        try:
            data = read_record(written(entry, folder), **entry.options).data
        except InputError as error:
            end = dead_end(first(entry), said(first(entry), folder), folder)
            return ("dead end", end) if end else ("refused", str(error).replace(f"{folder}/", ""))
        found = "it was read" if isinstance(entry.answer, Refused) else difference(data, entry.answer)
    except Exception as error:
        found = f"{type(error).__name__}: {error}"
    return ("wrong", found) if found else ("right", "")
