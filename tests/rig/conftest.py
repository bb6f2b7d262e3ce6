"""Emulated rigs for tests: a leg whose wiring is known, on a line."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

pytest.importorskip("serial", reason="the rig needs pyserial: pip install 'qpal[rig]'")

from twin.hardware.linkage import end_angles
from twin.parameters import JOINTS
from twin.rig.calibration import Calibration
from twin.rig.emulator import Emulator
from twin.rig.link import Link

TS = 0.02


def calibration_of(emulator: Emulator, **changes: float) -> Calibration:
    """What wire and zero would find, from the data sheet: the sensor's two outermost readings and the real ends."""
    plant, p = emulator.plant, emulator.plant.experiment.p
    low, high = end_angles(p, emulator.joint)
    values = {
        "port": emulator.port,
        "joint": emulator.joint,
        "channel": JOINTS.index(emulator.joint),
        "motor_reversed": plant.motor_sign != plant.sensor_sign,
        "low_counts": 0.0,
        "low_angle": plant.angle_of(0),
        "high_counts": float(plant.full),
        "high_angle": plant.angle_of(plant.full),
        "soft_low": low - 0.02,
        "soft_high": high + 0.02,
        "crossing": 2.0,
    }
    return Calibration(**(values | changes))


@pytest.fixture
def rig():
    """A context of an emulated rig, its link and its calibration: `with rig("shoulder", 1, garbled=0.1) as ...`."""

    @contextmanager
    def made(joint: str = "shoulder", seed: int = 1, **settings) -> Iterator[tuple[Emulator, Link, Calibration]]:
        changes = settings.pop("changes", {})
        with Emulator(joint, seed, **settings) as emulator, Link(emulator.port) as link:
            yield emulator, link, calibration_of(emulator, **changes)

    return made


@pytest.fixture
def steps():
    """Drawn levels (N,) [V], each held for 0.4 s."""

    def drawn(N: int = 400, seed: int = 0) -> np.ndarray:
        return np.repeat(np.random.default_rng(seed).uniform(-12.0, 12.0, -(-N // 20)), 20)[:N]

    return drawn
