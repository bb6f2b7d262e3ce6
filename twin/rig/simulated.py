"""A rig without hardware whose board is real: the firmware, executed by simavr, in front of the twin's leg."""

from collections.abc import Sequence

from twin.rig import wire
from twin.rig.avr import Avr, Port
from twin.rig.leg import Emulated, drawn_leg

FULL = 4092  # counts of a full reading, which is the sum of four conversions


class Simulated(Emulated):
    """The firmware on the pseudo-terminal `port`, in the time of a clock; a context manager.

    The leg and its wiring are those that `seed` draws for the emulated rig too; the potentiometer's noise is on each
    conversion. Raises InputError where a compiler or simavr is missing.
    """

    kind = "firmware"

    def __init__(self, joint: str = "thigh", seed: int = 0) -> None:
        self.plant, self.seed, self.full = drawn_leg(joint, seed), seed, FULL
        noise = self.plant.pot.noise / (self.plant.pot.span / 1024)  # in steps of a pin of 10 bits
        self._port = Port(Avr(self._step, noise, seed))
        self.port = self._port.port

    def _step(self, duties: Sequence[float], seconds: float) -> list[float]:
        """See `twin.rig.avr.Plant`."""
        leg = self.plant
        leg.step([wire.FULL * duty for duty in duties])
        return [*(leg.position(joint) / leg.full for joint in range(wire.JOINTS)), leg.supply() / leg.full]

    def close(self) -> None:
        """The board is gone."""
        self._port.close()
