"""Which lines of a serial capture are wrong although they look whole: the lines beside them tell."""

from collections.abc import Iterator, Sequence

import numpy as np

CLOCKS = ("t", "time", "ms", "us", "millis", "micros", "clock", "stamp", "timestamp", "tick", "ticks", "t_ms", "t_us")
RISING = 0.9  # part of the steps of a clock that rise, whatever was garbled
GAP = 10.0  # middle steps: a longer one is a gap, and is believed only if the clock goes on from there
FEW = 3
SPIKE = 8.0  # how far a lone value stands off, in steps that the signal makes
RARE = 0.02  # a spike that occurs oftener is the signal's own


def misfits(values: np.ndarray, names: Sequence[str]) -> tuple[int | None, np.ndarray]:
    """The column of the clock, None if there is none, and which rows of `values` (N, columns) have a wrong one (N,)."""
    wrong = np.zeros(len(values), dtype=bool)
    j = _clock(values, names)
    if j is None:
        return None, wrong
    t = values[:, j]
    steps = np.diff(t)
    longest = GAP * np.median(steps[steps > 0])
    for _ in range(3):  # two wrong lines in a row hide behind each other
        kept = np.flatnonzero(~wrong)
        before, own, after = t[kept[:-2]], t[kept[1:-1]], t[kept[2:]]
        between = (after > before) & (after - before <= 2 * longest)
        off = between & ((own < before) | (own > after))
        if not off.any():
            break
        wrong[kept[1:-1][off]] = True
    kept = np.flatnonzero(~wrong)
    wrong[kept[_islands(t[kept], longest)]] = True
    return j, wrong


def _clock(values: np.ndarray, names: Sequence[str]) -> int | None:
    named = [j for j, name in enumerate(names) if name.lower() in CLOCKS]
    for j in [*named, 0]:
        steps = np.diff(values[:, j])
        if len(steps) > 3 and (steps > 0).mean() >= RISING and np.isfinite(steps).all():
            return j
    return None


def _islands(t: np.ndarray, longest: float) -> np.ndarray:
    """Which stamps (N,) the clock visits only briefly: up to `FEW` that follow each other, before it goes on as it was.

    A gap, a wrap or a restart goes on from there, so it is no island; a lone stamp at an end is one.
    """
    steps = np.diff(t)
    ends = np.flatnonzero((steps < 0) | (steps > longest)) + 1
    starts, stops = np.r_[0, ends], np.r_[ends, len(t)]
    wrong = np.zeros(len(t), dtype=bool)
    last = None  # the last stamp of the run before that was believed
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        after = t[stop] if stop < len(t) else None
        lone = stop - start == 1 and (last is None or after is None) and len(starts) > 1
        back = last is not None and after is not None and 0 <= after - last <= (FEW + 1) * longest
        if lone or (stop - start <= FEW and back):
            wrong[start:stop] = True
        else:
            last = t[stop - 1]
    return wrong


def misspelt(values: np.ndarray, texts: Sequence[str], signs: bool) -> np.ndarray:
    """Which values (N,) are lone spikes that one character explains: 51 or 5123 between 512 and 514.

    With `signs` also 87 between -88 and -86, which a signal may do as well; so only where other lines lost characters.
    """
    wrong = np.zeros(len(values), dtype=bool)
    if len(values) < 10 or not np.isfinite(values).all():
        return wrong
    before, own, after = values[:-2], values[1:-1], values[2:]
    usual = max(3.0 * float(np.median(np.abs(np.diff(values)))), 1.0)
    alone = np.minimum(np.abs(own - before), np.abs(own - after)) > SPIKE * usual
    alone &= (np.sign(own - before) == np.sign(own - after)) & (np.abs(after - before) <= 2 * usual)
    longest = np.quantile([len(text.lstrip("+-")) for text in texts], 1 - RARE)
    for k in (np.flatnonzero(alone) + 1).tolist():
        low, high = sorted((values[k - 1], values[k + 1]))
        meant = any(low - usual <= each <= high + usual for each in _spelt(texts[k], signs))
        wrong[k] = meant or len(texts[k].lstrip("+-")) > longest + 1  # two numbers run together
    return wrong if wrong.mean() <= RARE else np.zeros(len(values), dtype=bool)


def _spelt(text: str, signs: bool) -> Iterator[float]:
    """The whole numbers that one more digit, one digit less, or a sign makes of `text`."""
    digits = text.lstrip("+-")
    sign = text[: len(text) - len(digits)]
    if digits.isdigit():
        for i in range(len(digits) + 1):
            yield from (float(sign + digits[:i] + each + digits[i:]) for each in "0123456789")
            if len(digits) > 1:
                yield float(sign + digits[:i] + digits[i + 1 :])
        if signs and not sign:
            yield -float(digits)
