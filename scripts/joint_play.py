"""The figure of docs/joint.md: position of the twin's links in their backlash, and two backlash models.

python scripts/joint_play.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import twin
from sysid.base import style
from sysid.blocks import CoastingPlay, Play
from twin.imperfections import of_group

QUIET = of_group("sensor")
FILE = Path(__file__).resolve().parent.parent / "docs" / "joint-play.png"
# Drag, pull0 [rad/sample^2] and pull1 [1/sample^2] of the two links, and what of the record is shown [s].
LINKS = {"shoulder": (0.003, 0.0, 0.0, 30.0), "shank": (0.03, 0.0262, 0.1, 60.0)}


@style.styled
def draw() -> Figure:
    """Drive angle above; link minus drive below: the twin, and backlash with and without link inertia."""
    figure, axes = style.sheet(2, len(LINKS), height=4.6)
    for column, (joint, (*link_values, seconds)) in zip(axes.T, LINKS.items(), strict=True):
        options = {"half_period": 2.5 if joint == "shoulder" else 10.0, "jitter": 0.5, "shrink": 0.6}
        drive, link = (
            twin.Experiment(joint, "sweep", 125.0, seed=0, options=options, without=QUIET, pot_side=side).run().y_true
            for side in ("drive", "link")
        )
        width = twin.truth(joint).backlash
        plain = Play().output(np.array([width, 0.0]), drive)
        coasting = CoastingPlay().output(np.array([width, 0.0, *link_values]), drive)
        t, n = np.arange(len(drive)) * 0.1, round(seconds / 0.1)
        column[0].plot(t[:n], np.rad2deg(drive[:n]), color=style.INK)
        column[0].set(title=joint, ylabel="drive [deg]")
        for y, colour, name, wide in (
            (link, style.INK, "twin", 2.4),
            (plain, style.INPUT, "play", 0.9),
            (coasting, style.MODEL, "coasting play", 1.2),
        ):
            error = np.rad2deg(np.sqrt(np.mean((y - link) ** 2)))
            label = name if y is link else f"{name}, {error:.2f} deg off"
            column[1].plot(t[:n], np.rad2deg(y - drive)[:n], color=colour, linewidth=wide, label=label)
        column[1].set(ylabel="link minus drive [deg]", xlabel="time [s]")
        style.legend(column[1], fontsize=7)
    return figure


if __name__ == "__main__":
    FILE.write_bytes(style.png(draw()))
