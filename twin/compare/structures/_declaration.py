"""What a leg may have that the twin has not: how it changes the twin's reading, with few values."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.compare.effects import Effect, Knob
from twin.plant.added import Grid

DT = 0.001  # [s] between the readings of a course, `twin.plant.stepping.TIMESTEP`
Read = Callable[[np.ndarray, np.ndarray, Mapping[str, float]], np.ndarray]
Guess = Callable[[np.ndarray, np.ndarray, np.ndarray, float], list[dict[str, float]]]
Drive = Callable[[Grid, Mapping[str, float]], np.ndarray]


@dataclass(frozen=True)
class Structure(Effect):
    """An effect outside the twin: `rows` are its knobs, each nominal where the structure is absent.

    It has one of two. read(x, u, values): the reading (steps,) [rad] of a leg that has it, from the twin's reading x
    (steps,) [rad] under the commands u (steps,) [V], both every `DT`, with the knobs' values by name; the drive does
    not feel it, as a screw or a high gear is between. drive(grid, values): what the drive has beside its parameters, a
    table of `twin.plant.added`. `tries` are values at which a search begins, if they are better than absence;
    guess(u, y, x, Ts) makes further ones from input [V], log and response [rad], each (N,).
    """

    rows: tuple[Knob, ...]
    read: Read | None = None
    drive: Drive | None = None
    tries: tuple[dict[str, float], ...] = ()
    guess: Guess | None = None


def structure(
    name: str,
    words: str,
    rows: tuple[Knob, ...],
    record: str,
    why: str,
    read: Read | None = None,
    drive: Drive | None = None,
    tries: Sequence[dict[str, float]] = (),
    guess: Guess | None = None,
) -> Structure:
    """The structure; `record` and `why` are those of an `Effect`."""
    return Structure(
        name, words, tuple(row.name for row in rows), (), record, why, rows, read, drive, tuple(tries), guess
    )
