"""Three imperfections that only declare themselves, and what the twin makes of them: run it, it prints JSON.

A file of its own, in a process of its own: the board is compiled with what stands in the table when it is imported.
"""

import json
import runpy
from typing import ClassVar

import numpy as np

from twin import imperfections
from twin.imperfections import Axis, Imperfection, Line, Mark, Signature, Size, board_row


class Warmth(Imperfection):
    """The winding warms up by the square of its voltage and cools: its resistance rises."""

    name, group = "warmth", "bridge"
    rows = (
        board_row("heating", 1e-3, 0, 1e-1, "1/(V² s)", "drive: rise of the resistance"),
        board_row("cooling", 2.0, 1, 1e4, "s", "drive: time constant of the cooling"),
    )
    ideal: ClassVar = {"heating": 0.0}
    board: ClassVar = {"HEATING": "heating", "COOLING": "cooling"}
    joint: ClassVar = {"WARM": 0.0}

    @staticmethod
    def step(board, j, s):
        volts = j[s.DUTY] * board[s.BUS]
        j[s.WARM] += board[s.STEP] * (board[s.HEATING] * volts * volts - j[s.WARM] / board[s.COOLING])

    @staticmethod
    def effect(j, s, value):
        return value / (1.0 + j[s.WARM])

    @staticmethod
    def show(p, lab):
        u = np.full(500, 0.5)
        run, base = lab.pair("warmth", ("friction",), p, "shoulder", u, 0.01)
        lines = tuple(Line(trial.t, trial.volts, on) for trial, on in ((run, True), (base, False)))
        sizes = [float(u[0] / trial.volts[-1] - 1.0) for trial in (run, base)]
        mark = Mark((0.0, 0.0), (1.0, 1.0), 1.0, "V")
        size = Size("resistance", sizes, 1.0, "1", ("heating",))
        return Signature("warmth", "Warm", "shoulder", Axis("t", "s"), Axis("u", "V"), lines, (mark,), (size,), "Warm.")


class Drift(Imperfection):
    """The reading drifts with time."""

    name, group = "drift", "sensor"
    rows = (board_row("drift_rate", 0.01, 0, 1, "rad/s", "pot: drift of its zero"),)
    ideal: ClassVar = {"drift_rate": 0.0}
    joint: ClassVar = {"ZERO": 0.0, "DRIFT_RATE": "drift_rate"}

    @staticmethod
    def step(board, j, s):
        j[s.ZERO] += board[s.STEP] * j[s.DRIFT_RATE]

    @staticmethod
    def effect(j, s, value):
        return value + j[s.ZERO]


class Rust(Imperfection):
    """Dry friction is a multiple of itself."""

    name, group = "rust", "friction"
    rows = (board_row("rust", 4.0, 1, 10, "1", "friction row: factor of dry friction"),)
    ideal: ClassVar = {"rust": 1.0}
    joint: ClassVar = {"RUST": "rust"}

    @staticmethod
    def effect(j, s, value):
        return value * j[s.RUST]


class Glare(Imperfection):
    """Its effect comes after that of the drift, in the order of the table: a multiple of the angle read."""

    name, group = "glare", "sensor"
    rows = (board_row("glare", 2.0, 1, 10, "1", "pot: factor of the reading"),)
    ideal: ClassVar = {"glare": 1.0}
    joint: ClassVar = {"GLARE": "glare"}

    @staticmethod
    def effect(j, s, value):
        return value * j[s.GLARE]


KINDS = (Warmth, Drift, Rust, Glare)


def main() -> None:
    imperfections.TABLE.update({kind.name: kind for kind in KINDS})
    imperfections.IMPERFECTIONS = tuple(imperfections.TABLE)
    from twin import Parameters, signatures
    from twin.ensemble.draws import whole_box
    from twin.plant import slots
    from twin.signatures import lab

    p = Parameters()

    def trials(name: str, volts: float, *others: str) -> list:
        return list(lab.pair(name, others, p, "shoulder", np.full(400, volts), 0.01))

    found = {
        "warm": [trial.volts.tolist() for trial in trials("warmth", 0.5, "friction")],
        "drift": [(trial.reading - trial.angle).tolist() for trial in trials("drift", 0.5, "friction")],
        "rust": [[float(np.ptp(trial.angle)) for trial in trials("rust", way * 3.0, "friction")] for way in (-1, 1)],
        "glare": [trial.reading.tolist() for trial in trials("glare", 0.5, "friction", "drift")],
        "shown": signatures.TABLE["warmth"](p).sizes[0].shown,
        "marks": [slots.MAGIC_VALUE, runpy.run_path(slots.__file__)["MAGIC_VALUE"]],
    }
    found["drawn"] = [dict(whole_box().draw(p, number).parameters.values) for number in range(8)]
    Glare.effect = Drift.effect
    found["marks"].append(runpy.run_path(slots.__file__)["MAGIC_VALUE"])
    print(json.dumps(found))


if __name__ == "__main__":
    main()
