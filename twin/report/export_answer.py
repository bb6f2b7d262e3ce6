"""The first screen of `qpal export`: what was written, what speaks against it, and how it is used."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from sysid.base.quantities import percent
from sysid.report.answer import GOOD, POOR, USABLE, Answer, Word
from sysid.report.page import Grid, Picture
from sysid.workflow.saved import UNFIT
from twin.studies.write_back import WrittenModel

USE = {  # how a file is taken into use, by the end of its name; of several the first here
    ".xml": "python -m mujoco.viewer --mjcf={place}",
    ".c": "cc -std=c99 -O2 -c {place} -o {stem}.o",
    ".fmu": 'python -c "import fmpy, sys; fmpy.dump(sys.argv[1])" {place}',
    ".m": 'octave --path {folder} --eval "help {name}"',
    "_control.py": "python -i {place}",
    ".py": "python -i {place}",
}


def answer(result: WrittenModel, picture: Picture, said: Sequence[str], folder: str) -> Answer:
    """The first screen; files that were compared with nothing have no word unless the fit speaks against itself."""
    n, check = len(result.files), result.check
    number, of = f"{n} file{'s' * (n != 1)}", "written from the fit, which they compute sample by sample"
    if check is not None:
        number, of = percent(100.0 * check.share), "of the stroke between the fit and its MJCF in MuJoCo, RMS"
    first = next((text for text in said if not text.startswith("In the files")), said[0] if said else "")
    return Answer(
        number,
        of,
        word(result),
        first.partition(";")[0].rstrip(".") + "." if first else "",
        picture,
        values=Grid(("file", "what it is"), result.files, text_columns=2),
        next=following(result, folder),
    )


def word(result: WrittenModel) -> Word | None:
    """Poor where the fit is unfit for use, or its elements differ from it."""
    source = result.source
    if any(text.startswith(UNFIT) for text in source.fit.warnings) or not result.close:
        return POOR
    if source.trouble or source.fit.warnings:
        return USABLE
    return None if result.check is None else GOOD


def following(result: WrittenModel, folder: str) -> str:
    """The command that takes the first of the files into use."""
    for end, command in USE.items():
        for name, _ in result.files:
            if name.endswith(end):
                place, path = shlex.quote(str(Path(folder) / name)), Path(name)
                stem = shlex.quote(str(Path(folder) / path.stem))
                words = {"place": place, "stem": stem, "folder": shlex.quote(folder), "name": path.stem}
                return f"Next: {command.format(**words)}"
    return ""
