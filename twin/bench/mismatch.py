"""Stand-ins whose structure no model has: actuators as bodies in a closed loop, and a crooked sensor."""

from collections.abc import Sequence
from dataclasses import dataclass

from sysid.base.errors import unknown
from sysid.bench.task import Task
from twin.bench.records import task
from twin.bench.standin import StandIn
from twin.parameters import JOINTS

LONG, SHORT = 60.0, 30.0  # [s] of the record and of the test
CHIRP = {"shoulder": (0.1, 1.0), "thigh": (0.05, 0.3), "shank": (0.05, 0.3)}  # [Hz]


@dataclass(frozen=True)
class Mismatch:
    """Scenario JOINT: an aprbs, then a chirp, on the stand-in that the seed draws; sampled as a rig's capture."""

    name: str = "mismatch"
    about: str = "stand-ins with hidden parameters, the other actuator realisation and a crooked potentiometer"

    def scenarios(self) -> Sequence[str]:
        """See `Family`."""
        return list(JOINTS)

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`."""
        if scenario not in JOINTS:
            raise unknown(f"scenario of {self.name}", scenario, JOINTS)
        rig, (low, high) = StandIn(scenario, seed), CHIRP[scenario]
        train, test = rig.log("aprbs", LONG, 2), rig.log("chirp", SHORT, 3, f_min=low, f_max=high)
        drawn = ", ".join(f"{name} {value:.4g}" for name, value in rig.parameters.changed().items())
        return task(train, test, f"{scenario}, closed loop, voltage; {drawn}")
