"""The first screen of `qpal info` without a file: what the joints of the twin do."""

import math
import shlex
from collections.abc import Callable

from sysid.base.quantities import number
from sysid.report.answer import Answer
from sysid.report.page import Grid, Picture
from twin.studies.information import Information, Joint


def answer(result: Information, picture: Picture, sentence: str) -> Answer:
    """The first screen; a table of parameters is neither good nor poor."""
    n = len(result.joints)
    words = ["qpal", "simulate", "--joint", result.joints[0].name]
    words += ["--params", result.source] if result.source else []
    return Answer(
        f"{n} joint{'s' * (n != 1)}",
        f"of the simulated leg, made of {len(result.values)} parameters: what an identification should find",
        None,
        sentence,
        picture,
        values=values(result),
        next=f"Next: {shlex.join(words)}",
    )


def values(result: Information) -> Grid:
    """What people ask of an actuator, a column for each joint."""
    rows: dict[str, Callable[[Joint], str]] = {
        "travel [deg]": lambda j: number(math.degrees(abs(j.truth.end_angles[1] - j.truth.end_angles[0])), 3),
        "speed at full supply, up [deg/s]": lambda j: number(math.degrees(j.up.top_speed), 3),
        "voltage that starts it, up [V]": lambda j: number(j.up.breakaway, 3),
        "backlash [deg]": lambda j: number(math.degrees(j.truth.backlash), 3),
    }
    grid_rows = [(words, *map(of, result.joints)) for words, of in rows.items()]
    return Grid(("", *(joint.name for joint in result.joints)), grid_rows)
