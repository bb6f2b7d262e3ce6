"""Missing data: short gaps are filled; mark long gaps with `IOData(missing=...)` or cut them out."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.base.checks import checked, short_text
from sysid.base.errors import InputError
from sysid.data.record import IOData


@dataclass(frozen=True)
class Filled:
    """Values (N,) with short gaps filled; `filled` (N,) marks them, `open` (N,) marks the rest (nan)."""

    values: np.ndarray
    filled: np.ndarray
    open: np.ndarray
    sentence: str


@checked(deferred=("values", "missing"))
def fill(values: np.ndarray, longest: int = 3, missing: np.ndarray | None = None, hold: bool = False) -> Filled:
    """Fill gaps of up to `longest` samples in values (N,): a straight line between neighbours, or the last value held.

    Values that are not finite or marked in `missing` (N,) are missing. Use a line for a measured output, and hold for
    an input that a controller holds. Longer gaps, and for a line gaps at either end, stay nan: invented values over
    many samples would count as data.
    """
    x = np.array(values, dtype=float).ravel()
    is_missing = ~np.isfinite(x)
    if missing is not None:
        mask = np.asarray(missing)
        if mask.dtype.kind not in "biuf":
            raise InputError(f"missing is {short_text(missing)}; give True where a sample is missing, or False")
        mask = mask.astype(bool).ravel()
        if mask.shape != x.shape:
            raise InputError(f"missing has {len(mask)} marks for {len(x)} samples; give one for each")
        is_missing |= mask
    if longest < 0:
        raise InputError(f"longest is {longest}; give the longest gap to fill, in samples")
    if is_missing.all():
        raise InputError("every sample is missing; give a record with measured samples")
    filled, gaps = np.zeros(len(x), dtype=bool), runs(is_missing)
    for start, stop in gaps:
        inside = stop < len(x) and start > 0
        if stop - start <= longest and (inside or (hold and start > 0)):
            filled[start:stop] = True
    measured, k = np.flatnonzero(~is_missing), np.flatnonzero(filled)  # few places of a long record
    bridge = (
        x[measured[np.maximum(np.searchsorted(measured, k, "right") - 1, 0)]]
        if hold
        else np.interp(k, measured, x[measured])
    )
    x[is_missing] = np.nan
    x[k] = bridge
    return Filled(x, filled, is_missing & ~filled, _sentence(gaps, filled, is_missing, longest, hold))


@checked(deferred=("u", "y", "Ts"))
def record(u: np.ndarray, y: np.ndarray, Ts: float, longest: int = 3, **names: Any) -> tuple[IOData, str]:
    """IOData from u (N,) and y (N,) with nan in them: short gaps filled, long ones of y marked as missing.

    Raises InputError for a long gap of u, because a free run cannot skip it: split the record there into experiments.
    """
    filled_input, line = fill(u, longest, hold=True), fill(y, longest)
    if filled_input.open.any():
        start, stop = runs(filled_input.open)[0]
        raise InputError(
            f"u is missing from sample {start} to {stop - 1} (from 0), longer than {longest} samples or at an end; "
            "split the record there and merge the parts as experiments"
        )
    data = IOData(filled_input.values, line.values, Ts, missing=line.open if line.open.any() else None, **names)
    return data, f"u: {filled_input.sentence}; y: {line.sentence}"


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of True in mask (N,) as (start, stop), stop excluded."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _sentence(gaps: list[tuple[int, int]], filled: np.ndarray, is_missing: np.ndarray, longest: int, hold: bool) -> str:
    if not gaps:
        return "no sample is missing"
    way = "the last value held" if hold else "straight lines"
    sentence = f"{int(filled.sum())} of {int(is_missing.sum())} missing samples filled by {way}"
    open_gaps = [(a, b) for a, b in gaps if not filled[a]]
    if open_gaps:
        worst = max(open_gaps, key=lambda g: g[1] - g[0])
        sentence += (
            f"; {len(open_gaps)} gap(s) not filled, the longest with {worst[1] - worst[0]} samples from {worst[0]} "
            "(limit "
            f"{longest}): mark them with IOData(missing=...) or cut them out"
        )
    return sentence
