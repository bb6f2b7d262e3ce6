"""What a leg may have that the twin has not: how it changes the twin's reading, with few values."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.compare.effects import Effect, Knob

DT = 0.001  # [s] between the readings of a course, `twin.plant.stepping.TIMESTEP`
Read = Callable[[np.ndarray, np.ndarray, Mapping[str, float]], np.ndarray]


@dataclass(frozen=True)
class Structure(Effect):
    """An effect outside the twin: `rows` are its knobs, each nominal where the structure is absent.

    read(x, u, values): the reading (steps,) [rad] of a leg that has it, from the twin's reading x (steps,) [rad] under
    the commands u (steps,) [V], both every `DT`, with the knobs' values by name. The drive does not feel it: a screw or
    a high gear is between. `tries` are values at which a search begins, if they are better than absence.
    """

    rows: tuple[Knob, ...]
    read: Read
    tries: tuple[dict[str, float], ...] = ()


def structure(
    name: str,
    words: str,
    rows: tuple[Knob, ...],
    read: Read,
    record: str,
    why: str,
    tries: Sequence[dict[str, float]] = (),
) -> Structure:
    """The structure; `record` and `why` are those of an `Effect`."""
    return Structure(name, words, tuple(row.name for row in rows), (), record, why, rows, read, tuple(tries))
