"""What a record leaves open of a backlash that the model of its joint has not."""

import numpy as np

from sysid.blocks import CoastingPlay, Play
from sysid.data.record import IOData
from sysid.estimation.initial_state import estimate_initial
from sysid.estimation.result import Fit
from sysid.joint.full import colour_level, linearised
from sysid.joint.prior import KNOWN, units_of
from sysid.joint.stops import reading_noise

_SIDES = (-0.5, 0.0, 0.5)  # of the backlash on which the link may lie at first
_RCOND = 1e-7  # of the largest, singular values below which a direction is not determined


def hidden_play(fit: Fit, data: IOData) -> float:
    """Standard deviation [y] of a backlash behind a joint without one; infinite where the model has one, or a sensor.

    The usual backlash is known, and the record tells of it what no parameter of the joint can make up for: a link that
    lies on one side of it throughout looks like a joint whose ends lie half of it elsewhere. On which side it lies at
    first is open: the one counts that tells least.
    """
    chain = fit.model
    if chain.block("sensor") is not None or any(isinstance(block, Play | CoastingPlay) for block in chain.blocks):
        return np.inf
    known = KNOWN[Play]["width"]
    usual = known.spread * units_of(chain, fit.theta, data)[known.of]
    width, play = max(reading_noise(data), 1e-3 * usual), Play()
    changes = np.zeros((int(data.observed[:, 0].sum()), len(_SIDES)))
    first = 0
    for k, record in enumerate(data.experiments):
        theta = fit.theta if k == 0 else estimate_initial(chain, fit.theta, record)
        y, seen = chain.simulate(theta, record.u[:, 0]), record.observed[:, 0]
        for i, side in enumerate(_SIDES):
            changes[first : first + seen.sum(), i] = ((play.output(np.array([width, side]), y) - y) / width)[seen]
        first += int(seen.sum())
    _, J = linearised(fit, data)
    scale = np.linalg.norm(J, axis=0)
    J = J / np.where(scale > 0.0, scale, 1.0)
    own = changes - J @ np.linalg.lstsq(J, changes, rcond=_RCOND)[0]
    told, level = float(np.sum(own**2, axis=0).min()), colour_level(fit, data)
    if not level > 0.0:  # a record without noise, which the joint follows exactly, tells all
        return 0.0 if told > 0.0 else usual
    told /= level**2
    return float(1.0 / np.sqrt(told + usual**-2))
