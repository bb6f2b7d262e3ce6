"""A stand-in for the rig: a leg with hidden parameters, the other realisation and effects that the twin lacks.

It records what a rig would: a capture of an MCU with milliseconds, codes of the converter and duty of the bridge, in
which some lines are garbled.
"""

from pathlib import Path

import numpy as np

import twin
from twin.bench.standin import DUTY, LACKS, RANGES, StandIn
from twin.bench.standin import draw_parameters as hidden
from twin.hardware.potentiometer import potentiometer
from twin.log import Log

__all__ = ["LACKS", "MAP", "RANGES", "StandIn", "capture", "hidden", "written"]

# How a capture is read: duty counts of the bridge on 12 V, and codes of the converter over 270 degrees.
MAP = """
[clock]
column = "millis"
unit = "ms"

[[input]]
column = "pwm"
unit = "V"
scale = 0.047058823529411764  # 12 V / 255

[[output]]
column = "adc"
unit = "deg"
adc = {counts = [0, 1024], value = [-135.0, 135.0]}
"""


def capture(log: Log, rng: np.random.Generator) -> str:
    """The log as the text that an MCU sends: "millis,adc,pwm" a line, one of 200 garbled, after its greeting."""
    pot = potentiometer(twin.Parameters())
    codes = np.round(log.y / pot.step).astype(int) + 2 ** ((pot.bits or 10) - 1)
    duty = np.round(log.u / twin.Parameters()["supply_voltage"] * DUTY).astype(int)
    lines = [f"{round(1e3 * t)},{c},{d}" for t, c, d in zip(log.t, codes, duty, strict=True)]
    garbled = rng.choice(np.arange(5, len(lines) - 5, 3), len(lines) // 200, replace=False)
    for k in garbled:
        line = lines[k]
        lines[k] = (line.rpartition(",")[0], line.replace(",", ";"), "\ufffd" + line)[rng.integers(3)]
    return "\n".join(["leg controller 1.3, ready", "millis,adc,pwm", *lines]) + "\n"


def written(rig: StandIn, folder: Path) -> tuple[list[Path], Path, Path]:
    """Captures to calibrate from, the held-out one, and the mapping to read them, as files in `folder`."""
    rng = np.random.default_rng([rig.seed, 55])
    (folder / "rig.toml").write_text(MAP, encoding="utf-8")
    paths = []
    for name, log in zip(("ends", "levels", "fresh"), (*rig.calibration(), rig.fresh()), strict=True):
        paths.append(folder / f"{name}.log")
        paths[-1].write_text(capture(log, rng), encoding="utf-8")
    return paths[:2], paths[2], folder / "rig.toml"
