"""What each dynamic reference record is made of. A plan has no data: `certify.py` draws and certifies them.

`free` are the true values of the parameters to estimate, `fixed` those that a record tells. noise is the standard
deviation at the output relative to that of the output, colour the pole of the noise. `domain` are the bounds of the
proof that the optimum is global, for the small ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Plan:
    """One record to make; N samples of an input of random steps of `hold` samples, on a grid of tenths to 2.

    `source` are the blocks and values of a system that the model does not contain; `second` is near a minimum that is
    not the lowest, where start1 then is.
    """

    name: str
    blocks: tuple[Mapping[str, Any], ...]
    free: Mapping[str, float]
    fixed: Mapping[str, str] = field(default_factory=dict)
    N: int = 60
    noise: float = 0.05
    colour: float = 0.0
    hold: int = 5
    domain: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    source: tuple[tuple[Mapping[str, Any], ...], Mapping[str, float]] | None = None
    second: Mapping[str, float] = field(default_factory=dict)


def tf(nb: int, nf: int, nk: int = 1, role: str = "linear") -> dict[str, Any]:
    """A filter at rest."""
    return {"kind": "transfer_function", "role": role, "nb": nb, "nf": nf, "nk": nk}


def sat(role: str) -> dict[str, Any]:
    """Limits."""
    return {"kind": "saturation", "role": role}


def poly(role: str, degree: int) -> dict[str, Any]:
    """Powers."""
    return {"kind": "polynomial", "role": role, "degree": degree}


def motor(role: str = "motor") -> dict[str, Any]:
    """A motor with dry friction, without stops, load or delay."""
    return {"kind": "motor", "role": role, "load": 0, "stops": False, "delayed": False}


STILL = {"motor.x0": "0", "motor.v0": "0"}
PLAY = {"kind": "play", "role": "play"}


def linear(b: list[float], f: list[float], role: str = "linear") -> dict[str, float]:
    """Values of a filter by name."""
    values = {f"{role}.b{i}": v for i, v in enumerate(b)}
    return values | {f"{role}.f{j}": v for j, v in enumerate(f, 1)}


POLE = {"linear.b0": (-5.0, 5.0), "linear.f1": (-1.0, 1.0)}  # one stable pole
GAIN = {"linear.b0": (0.05, 5.0), "linear.f1": (-1.0, 1.0)}  # and a gain of a known sign: behind it a limit is seen
ONE = "1"
PLANS = (
    Plan("oe_fast", (tf(1, 1),), linear([0.5], [-0.7]), domain=POLE),
    Plan("oe_slow", (tf(1, 1),), linear([0.1], [-0.95]), noise=0.1, hold=10, domain=POLE),
    Plan("oe_negative", (tf(1, 1),), linear([1.2], [0.6]), noise=0.2, hold=2, domain=POLE),
    Plan("oe_coloured", (tf(1, 1),), linear([0.4], [-0.8]), noise=0.2, colour=0.8, domain=POLE),
    Plan(
        "oe_zero", (tf(2, 1),), linear([0.6, -0.3], [-0.8]), noise=0.1, hold=3,
        domain=POLE | {"linear.b1": (-5.0, 5.0)},
    ),
    Plan(  # one pole for two: Johnson and Larimore 1977, Proceedings of the IEEE 65, 1399-1402
        "oe_two_minima", (tf(1, 1, 0),), linear([-0.311], [-0.906]), N=200, hold=1, domain=POLE,
        source=((tf(2, 2, 0),), linear([0.05, -0.4], [-1.1314, 0.25])), second=linear([0.114], [0.519]),
    ),
    Plan("oe_two_poles", (tf(1, 2),), linear([0.3], [-1.2, 0.35]), N=100),
    Plan("oe_resonant", (tf(2, 2),), linear([0.2, 0.1], [-1.5, 0.85]), N=120, noise=0.1),
    Plan("oe_near_poles", (tf(1, 2),), linear([0.036], [-1.62, 0.656]), N=200, noise=0.05, colour=0.7, hold=10),
    Plan("oe_three_poles", (tf(2, 3),), linear([0.2, -0.1], [-1.9, 1.23, -0.27]), N=200, noise=0.05, hold=6),
    Plan("oe_cancelling", (tf(2, 2),), linear([0.5, -0.37], [-1.45, 0.525]), N=150, noise=0.03, hold=3),
    Plan(
        "hammerstein_limit", (sat("input"), tf(1, 1)), {"input.upper": 1.0} | linear([0.5], [-0.7]),
        {"input.lower": "-10"}, domain=GAIN | {"input.upper": (0.0, 2.0)},
    ),
    Plan(
        "hammerstein_gain", (sat("input"), tf(1, 1)), {"input.upper": 0.85, "linear.f1": -0.8},
        {"input.lower": "-10", "linear.b0": "0.4"}, noise=0.2, colour=0.6,
        domain={"input.upper": (-2.0, 2.0), "linear.f1": (-1.0, 1.0)},
    ),
    Plan(
        "hammerstein_limits", (sat("input"), tf(1, 1)),
        {"input.lower": -0.7, "input.upper": 1.2} | linear([0.4], [-0.8]),
        N=80, noise=0.1, hold=4,
    ),
    Plan(
        "hammerstein_square", (poly("input", 2), tf(1, 1)), {"input.c1": 0.3, "input.c2": 0.8, "linear.f1": -0.7},
        {"input.c3": "0", "linear.b0": ONE},
        domain={"input.c1": (-5.0, 5.0), "input.c2": (-5.0, 5.0), "linear.f1": (-1.0, 1.0)},
    ),
    Plan(
        "hammerstein_cubic", (poly("input", 3), tf(1, 1)),
        {"input.c1": -0.15, "input.c2": 0.2, "input.c3": 1.0, "input.c4": 0.3, "linear.f1": -0.75},
        {"linear.b0": ONE}, N=100, noise=0.1, colour=0.6,
    ),
    Plan(
        "hammerstein_two_poles", (sat("input"), tf(1, 2)),
        {"input.lower": -1.1, "input.upper": 0.8} | linear([0.3], [-1.3, 0.5]), N=120, noise=0.1,
    ),
    Plan(
        "hammerstein_coloured", (sat("input"), tf(2, 1)),
        {"input.lower": -0.9, "input.upper": 0.9} | linear([0.3, 0.2], [-0.8]), N=100, noise=0.2, colour=0.9, hold=4,
    ),
    Plan(
        "wiener_limit", (tf(1, 1), sat("output")), {"output.upper": 0.9} | linear([0.5], [-0.7]),
        {"output.lower": "-100"}, domain=GAIN | {"output.upper": (0.05, 3.0)},
    ),
    Plan(
        "wiener_gain", (tf(1, 1), sat("output")), {"output.upper": 0.75, "linear.f1": -0.6},
        {"output.lower": "-100", "linear.b0": "0.6"}, noise=0.1, hold=3,
        domain={"output.upper": (-3.0, 3.0), "linear.f1": (-1.0, 1.0)},
    ),
    Plan(
        "wiener_limits", (tf(1, 1), sat("output")), {"output.lower": -0.8, "output.upper": 1.0} | linear([0.3], [-0.8]),
        N=100, noise=0.1,
    ),
    Plan(
        "wiener_square", (tf(1, 1), poly("output", 2)), {"output.c1": 0.2} | linear([0.4], [-0.6]),
        {"output.c2": ONE, "output.c3": "0"}, domain=POLE | {"linear.b0": (-3.0, 3.0), "output.c1": (-3.0, 3.0)},
    ),
    Plan(
        "wiener_cubic", (tf(1, 2), poly("output", 3)),
        {"output.c1": -0.05, "output.c2": 0.1} | linear([0.3], [-1.2, 0.4]),
        {"output.c3": ONE, "output.c4": "0"}, N=150, noise=0.05,
    ),
    Plan(
        "wiener_coloured", (tf(1, 1), sat("output")),
        {"output.lower": -0.6, "output.upper": 0.8} | linear([0.4], [-0.7]),
        N=100, noise=0.2, colour=0.8,
    ),
    Plan(
        "hw_limits", (sat("input"), tf(1, 1), sat("output")),
        {"input.lower": -1.2, "input.upper": 1.4, "output.lower": -0.9, "output.upper": 1.1} | linear([0.4], [-0.7]),
        N=120, noise=0.05,
    ),
    Plan(
        "hw_square", (poly("input", 2), tf(1, 1), sat("output")),
        {"input.c1": 0.2, "input.c2": 0.9, "linear.f1": -0.7, "output.lower": -1.5, "output.upper": 2.5},
        {"input.c3": "0", "linear.b0": ONE}, N=120, noise=0.1,
    ),
    Plan(
        "hw_coloured", (sat("input"), tf(1, 2), poly("output", 2)),
        {"input.lower": -1.0, "input.upper": 1.3, "output.c1": 0.15} | linear([0.3], [-1.2, 0.45]),
        {"output.c2": ONE, "output.c3": "0"}, N=200, noise=0.1, colour=0.7,
    ),
    Plan(
        "wh_limits", (tf(1, 1, role="linear1"), sat("middle"), tf(1, 1, 0, role="linear2")),
        {"linear1.b0": 0.5, "linear1.f1": -0.6, "middle.lower": -0.8, "middle.upper": 1.0, "linear2.f1": -0.8},
        {"linear2.b0": ONE}, N=150, noise=0.05,
    ),
    Plan(
        "wh_square", (tf(1, 1, role="linear1"), poly("middle", 2), tf(1, 1, 0, role="linear2")),
        {"linear1.b0": 0.5, "linear1.f1": -0.5, "middle.c1": 0.25, "linear2.f1": -0.85},
        {"middle.c2": ONE, "middle.c3": "0", "linear2.b0": ONE}, N=120, noise=0.05,
    ),
    Plan(
        "wh_near_poles", (tf(1, 1, role="linear1"), poly("middle", 3), tf(1, 1, 0, role="linear2")),
        {"linear1.b0": 0.4, "linear1.f1": -0.75, "middle.c1": -0.08, "middle.c2": 0.12, "linear2.f1": -0.7},
        {"middle.c3": ONE, "middle.c4": "0", "linear2.b0": ONE}, N=200, noise=0.1, colour=0.6,
    ),
    Plan(
        "play_after", (tf(1, 1), PLAY), {"play.width": 0.6} | linear([0.4], [-0.7]), {"play.rest": "0"},
        domain=GAIN | {"play.width": (0.0, 3.0)},
    ),
    Plan(
        "play_before", (PLAY, tf(1, 1)), {"play.width": 0.83} | linear([0.4], [-0.7]), {"play.rest": "0"}, hold=3,
        domain=GAIN | {"play.width": (0.0, 3.0)},
    ),
    Plan(
        "play_coloured", (tf(1, 1), PLAY), {"play.width": 0.5} | linear([0.3], [-0.8]), {"play.rest": "0"},
        N=100, noise=0.15, colour=0.7,
    ),
    Plan(
        "play_limits", (sat("input"), tf(1, 1), PLAY),
        {"input.lower": -1.2, "input.upper": 1.0, "play.width": 0.5} | linear([0.5], [-0.7]), {"play.rest": "0"},
        N=150, noise=0.05,
    ),
    Plan(
        "play_two_poles", (tf(1, 2), PLAY), {"play.width": 0.4} | linear([0.3], [-1.3, 0.5]), {"play.rest": "0"},
        N=120, noise=0.1,
    ),
    Plan(
        "joint_friction", (motor(),),
        {"motor.gain": 0.8, "motor.lag": 2.5, "motor.rise": 0.35, "motor.fall": 0.45}, STILL,
        N=100, noise=0.02,
    ),
    Plan(
        "joint_coloured", (motor(),),
        {"motor.gain": 1.2, "motor.lag": 1.5, "motor.rise": 0.55, "motor.fall": 0.4}, STILL,
        N=150, noise=0.05, colour=0.8, hold=4,
    ),
    Plan(
        "joint_play", (motor(), PLAY),
        {"motor.gain": 0.8, "motor.lag": 2.0, "motor.rise": 0.35, "motor.fall": 0.45, "play.width": 1.5},
        STILL | {"play.rest": "0"}, N=150, noise=0.02,
    ),
)  # fmt: skip
