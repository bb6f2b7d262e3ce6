"""When two sampling times are the same: one rule for every place that compares them.

A clock that is off by the part d stretches the time of a model by d: its poles and speeds are wrong by d, and sample N
of two records that are laid side by side is N d samples off. Crystals are off by up to 100 ppm, so two boards differ by
200 ppm; a model from a record is known to a part in a thousand at best. RC oscillators (1 %) are another rate.
"""

SAME = 3e-4  # of a sampling time
EQUAL = 1e-9  # the same number but for rounding: nothing to tell
TOLD = 0.05  # samples at the end of a record: less than that is below any noise


def same_rate(Ts: float, other: float) -> bool:
    """Whether two sampling times [s] are those of one rate."""
    return abs(Ts - other) <= SAME * min(Ts, other)


def drift_note(Ts: float, of_model: float, N: int, of: str = "the model's") -> str:
    """What taking `Ts` [s] for `of_model` [s] does over N samples; nothing where the numbers are equal."""
    part = Ts / of_model - 1.0
    if abs(part) <= EQUAL:
        return ""
    shift = abs(part) * (N - 1)
    small = " (too little to matter)" if shift < TOLD else ""
    return (
        f"the record's clock is {1e6 * abs(part):.3g} ppm {'slower' if part > 0 else 'faster'} than {of}: taken for "
        f"the same sampling time of {of_model:g} s; its last sample lies {shift:.2g} samples off by that{small}"
    )
