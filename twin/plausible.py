"""Whether the numbers of a log can be those of a joint of the leg: exchanged columns, misnamed units.

A search in the twin would take minutes, or days of simulated time, to find that nothing explains such a log.
"""

import numpy as np

from sysid.base.errors import InputError
from twin.hardware.linkage import end_angles, stroke
from twin.log import Log
from twin.parameters import Parameters

WIDER = 3.0  # times the stroke: what no offset, slope or other leg explains; degrees would be 57 times
SLOWER = 2.0  # times the stroke in one step: a slower leg, of which a sample still shows a motion
LARGER = 10.0  # times the supply: a voltage that no drive gives; millivolts would be 1000 times
_RARE = 0.005  # of the samples at either end, which may be spikes
_MAP = "in a mapping (qpal info FILE --write-map MAP.toml) and give it with --map"


def check_plausible(log: Log, joint: str, parameters: Parameters, label: str = "the log") -> None:
    """Raises InputError for a log that cannot be of `joint`, with the numbers that say so and what to set."""
    data = log.io(joint if log.joint else None)
    u, y = data.u[:, 0], data.y[data.observed[:, 0], 0]
    low, high = end_angles(parameters, joint)
    supply, moves = parameters["supply_voltage"], high - low
    span, drive = _span(y), _span(u)
    largest = float(np.quantile(np.abs(u), 1.0 - _RARE))
    if span > WIDER * moves:
        said = f"the angle of {label} spans {span:.3g} rad and the {joint} moves {moves:.3g} rad from end to end"
        if log.mode == "voltage" and drive <= WIDER * moves and float(np.abs(y).max()) <= LARGER * supply:
            raise InputError(
                f"{said}, while the voltage spans {drive:.3g} V only: the columns may be exchanged; correct the header "
                f"of the log, or exchange the columns of [[input]] and [[output]] {_MAP}"
            )
        raise InputError(
            f'{said}: the angle may be in another unit; name the unit of its numbers, as unit = "deg", under '
            f"[[output]] {_MAP}"
        )
    if log.u_unit == "V" and largest > LARGER * supply:
        raise InputError(
            f"the voltage of {label} reaches {largest:.5g} V and the supply has {supply:g} V: it may be in another "
            f'unit; name the unit of its numbers, as unit = "mV", under [[input]] {_MAP}'
        )
    volts = min(largest, supply) if log.mode == "voltage" else supply
    crossing = _crossing(parameters, joint, volts)
    if log.Ts > SLOWER * crossing:
        raise InputError(
            f"{label} is sampled every {log.Ts:g} s, and at {volts:.3g} V the {joint} crosses its whole stroke in "
            f'{crossing:.2g} s: the times may be in another unit; name it, as unit = "ms", under [clock] {_MAP}'
        )


def _span(x: np.ndarray) -> float:
    """The range of x (N,) without its rarest values."""
    low, high = np.quantile(x, (_RARE, 1.0 - _RARE))
    return float(high - low)


def _crossing(parameters: Parameters, joint: str, volts: float) -> float:
    """Time [s] in which the unloaded drive goes from end to end; infinite without a voltage."""
    low, high = stroke(parameters, joint)
    speed = parameters[f"{joint}.no_load_speed"] * volts / parameters[f"{joint}.rated_voltage"]
    return (high - low) / speed if speed > 0.0 else float("inf")
