"""Parts that a motor may have beside its friction, load and stops: one file and one line in `TABLE` each.

`drag_of_parts` and `drive_of_parts` are what the motor's step calls for all of them.
"""

import linecache
from collections.abc import Callable, Iterable, Mapping
from types import FunctionType

from sysid.motor_parts._part import Known, MotorPart
from sysid.motor_parts.warming import WARMING
from sysid.motor_parts.windage import WINDAGE

TABLE: dict[str, MotorPart] = {part.name: part for part in (WINDAGE, WARMING)}
ABSENT: Mapping[str, float] = {name: value for part in TABLE.values() for name, value in part.absent.items()}


def _written(text: str, functions: Iterable[Callable]) -> FunctionType:
    """The function of this text, whose source Python finds again: the compiler of steps reads it."""
    name = text[4 : text.index("(")]
    file, names = f"<{__name__}.{name}>", {f.__name__: f for f in functions}
    exec(compile(text, file, "exec"), names)
    linecache.cache[file] = (len(text), None, text.splitlines(True), file)
    written = names[name]
    assert isinstance(written, FunctionType)
    return written


def _sum(name: str, arguments: str, lines: Mapping[str, str], last: str) -> FunctionType:
    """A function of all parts: a line for each that is in `lines`, where the motor has it."""
    steps = [f"    if block.has_{part}:\n        {line}\n" for part, line in lines.items()]
    functions = [f for part in TABLE.values() for f in (part.drag, part.drive) if f is not None]
    first = f"    {last} = 0.0\n" if last not in arguments else ""
    return _written(f"def {name}({arguments}):\n{first}{''.join(steps)}    return {last}\n", functions)


_DRAGS = {name: f"drag += {part.drag.__name__}(s, p)" for name, part in TABLE.items() if part.drag is not None}
_DRIVES = {name: f"w = {part.drive.__name__}(s, w, h, p)" for name, part in TABLE.items() if part.drive is not None}
drag_of_parts = _sum("drag_of_parts", "s, p, block", _DRAGS, "drag")
drive_of_parts = _sum("drive_of_parts", "s, w, h, p, block", _DRIVES, "w")

__all__ = ["ABSENT", "TABLE", "Known", "MotorPart", "drag_of_parts", "drive_of_parts"]
