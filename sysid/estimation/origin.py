"""What a fit was made from, as far as a saved model must know it."""

from dataclasses import dataclass

import numpy as np

from sysid.data.record import IOData


@dataclass(frozen=True)
class Origin:
    """Names and units of the estimation data, its number of samples, and the fit [%] of the free run there."""

    u_name: str
    y_name: str
    u_unit: str
    y_unit: str
    samples: int
    fit: float

    @classmethod
    def of(cls, data: IOData, fit: float) -> "Origin":
        """Of a fit to `data` whose free run has this fit [%]."""
        return cls(data.u_name, data.y_name, data.u_unit, data.y_unit, data.N, float(fit))


def share_explained(data: IOData, mse: float) -> float:
    """Fit [%] of errors with this mean square: of one output, or of all outputs together."""
    seen = data.observed
    y = [column[mask] for column, mask in zip(data.y.T, seen.T, strict=True)]
    size = sum(float(np.sum((part - part.mean()) ** 2)) for part in y)
    return 100.0 * (1.0 - float(np.sqrt(mse * seen.sum() / size))) if size > 0 else float("-inf")
