"""Whether a log moves as the model does, before anything is searched: turned signs, and degrees taken for radians."""

import numpy as np

from sysid.base.errors import InputError
from twin.mjcf.logs import RobotLog
from twin.mjcf.robot import Drive
from twin.mjcf.simulation import Rig, free_run

TURN = 2.0 * np.pi  # [rad] a joint seldom moves further, so larger numbers are degrees
DEGREES = 180.0 / np.pi
OFF = 2.0  # factor by which a ratio of motions may miss that of the units
ALIKE = 0.5  # correlation beyond which two motions are one, turned round or not


def check(rig: Rig, log: RobotLog) -> list[str]:
    """Sentences about motors whose motion looks turned, or in another unit; raises InputError with one for a servo.

    A servo should go where its commands are, so there a contradiction is sure.
    """
    values, texts = np.array([each.before for each in rig.parameters]), []
    model = free_run(rig, values, log.u, log.Ts, log.start, log.posture)
    for k, drive in enumerate(rig.robot.drives):
        seen = np.isfinite(log.y[:, k])
        y, u, simulated = log.y[seen, k], log.u[seen, k], model[seen, k]
        told = [each for each in ((u, simulated) if drive.servo else (simulated,)) if np.all(np.isfinite(each))]
        if not told or min(map(np.ptp, (y, *told))) == 0.0:
            continue
        likeness = max(float(np.corrcoef(y, each)[0, 1]) for each in told)
        ratio = float(np.std(y) / np.std(told[0]))
        text = _turned(log, drive, likeness) if likeness < -ALIKE else _unit(log, drive, likeness, ratio, k)
        if text and drive.servo:
            raise InputError(text)
        texts += [f"{text[0].upper()}{text[1:]}."] if text else []
    return texts


def _turned(log: RobotLog, drive: Drive, likeness: float) -> str:
    return (
        f"{log.name}: {drive.name} moves the other way than the model (correlation {likeness:.2f}); set sign = -1 "
        f"under the [[output]] of its position in a mapping (qpal info {log.name} --write-map MAP.toml), and give it "
        "with --map MAP.toml"
    )


def _unit(log: RobotLog, drive: Drive, likeness: float, ratio: float, k: int) -> str:
    """Which of position and command is in the other unit; nothing where the motions are of one size."""
    if drive.unit != "rad" or likeness < ALIKE or not 1.0 / OFF < max(ratio, 1.0 / ratio) / DEGREES < OFF:
        return ""
    large, files = ratio > 1.0, log.units[k] if log.units else ("", "")
    command, position = (np.ptp(each[np.isfinite(each)]) > TURN for each in (log.u[:, k], log.y[:, k]))
    if large:
        role, unit = ("position", "deg") if position or files[0] != "deg" else ("command", "rad")
    else:
        role, unit = ("command", "deg") if drive.servo and (command or files[1] != "deg") else ("position", "rad")
    size = f"{ratio:.3g} times" if large else f"1/{1.0 / ratio:.3g} of"
    return (
        f"{log.name}: the position of {drive.name} moves {size} what its commands ask for, as degrees against radians; "
        f'the {role} seems to be in {unit}: write the unit in its header, as in "{role} [{unit}]"'
    )
