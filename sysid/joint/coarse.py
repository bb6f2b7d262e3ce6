"""A record at fewer samples per second."""

import numpy as np

from sysid.data.record import IOData
from sysid.joint.rate import powers
from sysid.model.chain import Chain

ENOUGH = 2500  # samples that show what a joint is made of
_WAY = 25.0  # samples from end to end, at the least: a motor's way is still seen
_FAST = 0.95  # quantile of the speeds that counts as the joint's


def factor(data: IOData, chain: Chain) -> int:
    """How many samples may become one; 1 where the record is short, has gaps, or the chain holds a time of its own."""
    given = {name for name in (*chain.fixed, *chain.bounds) if not name.endswith(".v0")}
    timed = any(power and name in given for name, power in zip(chain.names, powers(chain), strict=True))
    if timed or data.missing is not None:
        return 1
    steps = np.concatenate([np.abs(np.diff(e.y[:, 0])) for e in data.experiments])
    moving = steps[steps > 0.0]
    way = float(np.ptp(data.y)) / float(np.quantile(moving, _FAST)) if len(moving) else 0.0
    return max(1, min(data.N // ENOUGH, int(way / _WAY)))


def coarse(data: IOData, k: int) -> IOData:
    """The record with k samples as one: the mean of the input over them, and the output at their beginning."""
    if k == 1:
        return data
    parts = []
    for e in data.experiments:
        n = e.N // k
        whole = e.select(0, n * k)
        parts.append(
            IOData(
                whole.u.reshape(n, k, -1).mean(axis=1),
                whole.y[::k],
                k * data.Ts,
                **{name: getattr(data, name) for name in ("u_name", "y_name", "u_unit", "y_unit")},
                u_offset=data.u_offset,
                y_offset=data.y_offset,
            )
        )
    return IOData.merge(*parts)
