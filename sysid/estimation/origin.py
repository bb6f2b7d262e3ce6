"""What a fit was made from, as far as a saved model must know it."""

from dataclasses import dataclass

import numpy as np

from sysid.base.errors import InputError
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

    def other_unit(self, data: IOData) -> tuple[str, str, str] | None:
        """The first of "input" and "output" whose stated unit is another: its name, its unit, and the unit here."""
        for role, now, was in (("input", data.u_unit, self.u_unit), ("output", data.y_unit, self.y_unit)):
            if _plain(was) and _plain(now) and _plain(was) != _plain(now):
                return role, now, was
        return None


_SPELLED = str.maketrans({"°": "deg", "º": "deg", "µ": "u", "μ": "u", **dict.fromkeys(" *·.?-", None)})


def _plain(unit: str) -> str:
    """A unit without what spells it differently: N*m, N m and Nm are one; nothing for a dash."""
    return unit.translate(_SPELLED)


def check_units(data: IOData, origin: Origin | None) -> None:
    """Raises InputError for a record that states other units than those of a fit's record."""
    other = None if origin is None else origin.other_unit(data)
    if other is not None:
        role, now, was = other
        raise InputError(
            f"the {role} of the record is in {now} and the model's in {was}; convert the record, or correct the unit "
            f"with dataclasses.replace(data, {'u' if role == 'input' else 'y'}_unit={was!r})"
        )


def check_same_kind(data: IOData, Ts: float, origin: Origin | None) -> None:
    """Raises InputError for a record of another sampling time [s] or other units than a model's."""
    if abs(data.Ts - Ts) > 1e-6 * Ts:
        raise InputError(f"the record is sampled every {data.Ts} s and the model every {Ts} s; resample it first")
    check_units(data, origin)


def share_explained(data: IOData, mse: float) -> float:
    """Fit [%] of errors with this mean square: of one output, or of all outputs together."""
    seen = data.observed
    y = [column[mask] for column, mask in zip(data.y.T, seen.T, strict=True)]
    size = sum(float(np.sum((part - part.mean()) ** 2)) for part in y)
    return 100.0 * (1.0 - float(np.sqrt(mse * seen.sum() / size))) if size > 0 else float("-inf")
