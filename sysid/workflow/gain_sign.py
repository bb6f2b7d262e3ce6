"""Whether a model and its record agree on the sign of the gain."""

import numpy as np

from sysid.base.units import shown
from sysid.data.record import IOData
from sysid.diagnosis.direction import confirmed, direction

WRONG = "the WRONG SIGN"
_SETTLED = 0.2  # of the largest value of a step response, below which its end has no sign worth the name


def gain_remarks(estimation: IOData, validation: IOData, run: np.ndarray, step: np.ndarray | None) -> list[str]:
    """One sentence for each way in which the model goes against the record.

    None where the record leaves a doubt, or has several inputs or outputs.
    `run` (N,) is the free run over `validation`, `step` (n,) the response of the tangent model to a unit step.
    """
    one = estimation.u.shape[1] == estimation.y.shape[1] == 1
    way = direction(estimation) if one else 0
    if not way:
        return []
    y, u = estimation.y_name, estimation.u_name
    seen = f"in the estimation data {y} {'rises' if way > 0 else 'falls'} when {u} rises"
    q = shown("", estimation.y_unit if estimation.u_unit else "")
    unit = f" {q.unit}/{estimation.u_unit}" if q.unit else ""
    found = []
    if direction(validation, run) == -way:
        found.append(f"the free run has {WRONG}: {seen}, and the model does the opposite")
    if step is not None and step[-1] * way < 0.0 and abs(step[-1]) > _SETTLED * float(np.max(np.abs(step))):
        gain = f"{step[-1] * q.factor:.3g}{unit}"
        found.append(
            f"the steady-state gain of the model at the mean input, {gain}, has {WRONG}: {seen}; do not design with "
            "this model"
        )
    return found if found and confirmed(estimation, way) else []
