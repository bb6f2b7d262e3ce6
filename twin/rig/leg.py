"""The twin's leg in place of hardware: one joint with its motor, its potentiometer and its supply, drawn by a seed."""

from collections import deque
from typing import ClassVar

import mujoco
import numpy as np

from sysid.base.errors import InputError
from twin.bench.standin import draw_parameters
from twin.experiment import SETTLE, Experiment
from twin.hardware.potentiometer import potentiometer
from twin.parameters import JOINTS, Parameters
from twin.plant import slots
from twin.plant.stepping import TIMESTEP, boards
from twin.rig import wire
from twin.rig.calibration import SUPPLY_FULL
from twin.rig.closing import Closing

BITS_WITHOUT_ADC = 15
# What the rig does in its own way: the line loses samples, and the firmware's clock does not jitter.
ELSEWHERE = ("jitter", "dropouts")
TROUBLES = ("unplugged", "stuck", "reversed", "no supply")


class LegPlant:
    """One joint of the leg on its channel of the board, stepped by MuJoCo; the other channels rest at mid range.

    `motor_sign` and `sensor_sign` are the wiring. `trouble` is one of `TROUBLES` or empty.
    """

    def __init__(self, experiment: Experiment, motor_sign: int, sensor_sign: int) -> None:
        self.experiment, self.motor_sign, self.sensor_sign = experiment, motor_sign, sensor_sign
        self.channel, self.trouble = JOINTS.index(experiment.joint), ""
        p = experiment.p
        self.pot = potentiometer(p, experiment.without)
        bits = self.pot.bits or BITS_WITHOUT_ADC
        self.full, self.count = 2**bits - 1, self.pot.span / 2**bits
        self.supply_volts = p["supply_voltage"]
        run = experiment.prepare(u=np.zeros((experiment.N, 1)))
        self._model, self._data = run.model, mujoco.MjData(run.model)
        self._data.qpos[:], self._data.userdata[:] = run.qpos, run.user_data
        self._joint = self._data.userdata[slots.HEAD : slots.HEAD + slots.WIDTH]
        self._delay = round(run.delay / TIMESTEP)
        self._noise, self._idle_noise = experiment.generator("noise"), np.random.default_rng([experiment.seed, 41])
        self._stuck, self.logs = 0.0, False
        self.switch_off()
        self.rest(SETTLE)

    def _angle(self) -> float:
        """What the potentiometer shows without noise [rad]."""
        from twin.plant.electronics import angle_read

        return float(angle_read(self._joint, self._data.qpos))

    def _counts(self, angle: float) -> float:
        place = angle / self.count + 0.5 * (self.full + 1)
        return place if self.sensor_sign > 0 else self.full - place

    def angle_of(self, counts: float) -> float:
        """The angle [rad] that a reading stands for: the data sheet's scale in place of a protractor."""
        place = counts if self.sensor_sign > 0 else self.full - counts
        return (place - 0.5 * (self.full + 1)) * self.count

    def position(self, joint: int) -> float:
        """See `Plant`."""
        if joint != self.channel:
            return 0.5 * self.full
        if self.trouble in ("unplugged", "stuck"):
            return 0.0 if self.trouble == "unplugged" else self._stuck
        return self._counts(self._angle())

    def reading(self, joint: int) -> int:
        """See `Plant`."""
        noise = self._noise if self.logs else self._idle_noise
        shift = self.pot.noise * float(noise.standard_normal()) if joint == self.channel else 0.0
        place = self.position(joint) + self.sensor_sign * shift / self.count
        # The converter rounds the angle half to even, so that the twin's own log has the same codes.
        place = place if self.sensor_sign > 0 else self.full - place
        code = int(np.clip(np.round(place), 0, self.full))
        return code if self.sensor_sign > 0 else self.full - code

    def supply(self) -> int:
        """See `Plant`."""
        volts = 0.0 if self.trouble == "no supply" else float(self._data.userdata[slots.BUS])
        return min(int(volts / SUPPLY_FULL * self.full), self.full)

    def step(self, duties: list[float]) -> None:
        """See `Plant`."""
        sign = self.motor_sign * (-1 if self.trouble == "reversed" else 1)
        self._queue.append(sign * duties[self.channel] / wire.FULL * self.supply_volts)
        self._data.ctrl[0] = self._queue.popleft()
        with boards():
            mujoco.mj_step(self._model, self._data)

    def switch_off(self) -> None:
        """See `Plant`."""
        self._queue = deque([0.0] * self._delay)

    def rest(self, seconds: float) -> None:
        """The drive is off for so long."""
        for _ in range(round(seconds / TIMESTEP)):
            self.step([0.0] * wire.JOINTS)

    def break_down(self, trouble: str) -> None:
        """One of `TROUBLES` happens, or ends where the name is empty."""
        self._stuck = self.position(self.channel)
        self.trouble = trouble


def drawn_leg(
    joint: str,
    seed: int,
    parameters: Parameters | None = None,
    without: tuple[str, ...] = (),
    signs: tuple[int, int] | None = None,
) -> LegPlant:
    """A joint with parameters drawn by `seed`, unless they are given, whose motor and sensor are wired either way
    round, unless `signs` (motor, sensor) are given. Raises InputError for an unknown joint."""
    if joint not in JOINTS:
        raise InputError(f"an emulated rig has one joint; choose one of {', '.join(JOINTS)}, not {joint!r}")
    p = draw_parameters(joint, seed) if parameters is None else parameters
    without = tuple(dict.fromkeys((*without, *ELSEWHERE)))
    drawn = np.random.default_rng([seed, 40]).choice((-1, 1), 2)
    motor_sign, sensor_sign = (int(sign) for sign in (drawn if signs is None else signs))
    return LegPlant(Experiment(joint, "sweep", 10.0, 0.1, seed, without, p), motor_sign, sensor_sign)


class Emulated(Closing):
    """A rig without hardware on the pseudo-terminal `port`: `plant`, which `seed` drew, behind a board.

    `kind` is its name at the command line, `full` the counts of a full reading of its board.
    """

    kind: ClassVar[str]
    port: str
    plant: LegPlant
    seed: int
    full: int

    @property
    def joint(self) -> str:
        """Its joint's name."""
        return self.plant.experiment.joint

    @property
    def supply(self) -> float:
        """[V]."""
        return self.plant.supply_volts

    @property
    def linearity(self) -> float:
        """Largest deviation of the potentiometer from a straight line, by its data sheet [rad]."""
        return self.plant.pot.nonlinearity

    def angle_of(self, counts: float) -> float:
        """The angle [rad] that a reading of the board stands for: the data sheet's scale in place of a protractor."""
        return self.plant.angle_of(counts * self.plant.full / self.full)

    def truth(self, Ts: float) -> dict[str, float]:
        """The hidden values, with names and units of `sysid.joint_values`."""
        from twin.studies.beyond import twin_truth  # loads what fits models, which no cable waits for

        return twin_truth(self.joint, Ts, self.plant.experiment.p)
