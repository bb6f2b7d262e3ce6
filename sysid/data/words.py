"""The sign of a word that was logged without it: two's complement, or one bit for the sign beside the magnitude.

Whether numbers are such words is a question of description length (Rissanen, Automatica 14, 1978): a reading that takes
them for words is another code of the same numbers, one for one, so the bits that it saves are its evidence. The numbers
as they are may be a walk, values all over a range, two bands, or a few levels; the numbers with a sign as well.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

BITS: tuple[Literal[8, 16, 24, 32], ...] = (8, 16, 24, 32)  # of words in two's complement
FEWEST_BITS = 7  # of a magnitude: a byte with a sign
READINGS = len(BITS) + 32 - FEWEST_BITS  # none of them is more likely than another before the numbers are seen
SURE, LIKELY = 10.0, 3.0  # bits: odds of 1,000 to 1 that a reading is right, which then is used; of 8 to 1: offered
LENGTH = 5.0  # bits that say how many digits a number below 2^32 has
LONGEST = 50_000  # samples that are looked at, about the first change


@dataclass(frozen=True)
class Word:
    """A reading of whole numbers as words: of `signed` bits in two's complement, or with a `sign_bit`.

    `evidence` [bits] is what the reading saves of a description of the numbers.
    """

    signed: Literal[0, 8, 16, 24, 32] = 0
    sign_bit: int = 0
    evidence: float = 0.0

    @property
    def sure(self) -> bool:
        """Whether the reading is beyond doubt, else it is likely."""
        return self.evidence >= SURE

    @property
    def kind(self) -> str:
        """What the words are."""
        signed = f"words of {self.signed} bits in two's complement"
        return signed if self.signed else f"words of a magnitude and a sign, which is bit {self.sign_bit}"

    @property
    def entry(self) -> str:
        """The entry of a mapping that reads the numbers so."""
        return f"signed = {self.signed}" if self.signed else f"sign_bit = {self.sign_bit}"


def with_sign(x: np.ndarray, bits: int, sign_bit: int) -> tuple[np.ndarray, np.ndarray]:
    """The words x (n,) with their sign, and which of them are none of this kind.

    `bits` are those of two's complement; `sign_bit` is the place, from 0, of the bit that says minus.
    """
    half = 2.0**sign_bit if sign_bit else 2.0 ** (bits - 1)
    lowest = 0.0 if sign_bit else -half
    bad = np.isfinite(x) & ((x < lowest) | (x >= 2.0 * half) | (x != np.rint(x)))
    return np.where(x >= half, half - x if sign_bit else x - 2.0 * half, x), bad


def word_of(x: np.ndarray) -> Word | None:
    """The words that the numbers x (n,) are by their own evidence, None if they more likely are plain numbers."""
    x = x[np.isfinite(x)]
    if len(x) < 3 or x.min() < 0.0 or not 2.0**FEWEST_BITS <= x.max() < 2.0**32 or np.any(x != np.rint(x)):
        return None
    bit = int(np.log2(x.max()))
    minus = x >= 2.0**bit
    if minus.all() or not np.any(minus[:-2] & minus[1:-1] & minus[2:]):  # a glitch does not stay
        return None
    start = max(int(np.argmax(np.diff(minus))) - LONGEST // 2, 0)
    x, minus = x[start : start + LONGEST], minus[start : start + LONGEST]
    new = np.append(True, np.diff(x) != 0.0)  # a number that is held says nothing
    readings = [Word(sign_bit=bit), *(Word(signed=bits) for bits in BITS if bits == bit + 1)]
    words = [replace(word, evidence=_evidence(x[new], minus[new], word)) for word in readings]
    best = max(words, key=lambda word: word.evidence)
    return best if best.evidence > LIKELY else None


def _evidence(x: np.ndarray, minus: np.ndarray, word: Word) -> float:
    """Bits that the reading of x (n,) as words saves."""
    signed, _ = with_sign(x, word.signed, word.sign_bit)
    turn = 2.0 ** (word.signed or word.sign_bit + 1)
    plain = _length_plain(x, minus)
    if word.sign_bit or np.abs(np.diff(signed)).max() > 0.5 * turn:  # else a counter within one turn has this sign
        plain = min(plain, _walk(np.unwrap(x, period=turn)))
    return plain - _length_signed(signed, minus) - float(np.log2(READINGS)) if signed[minus].any() else -np.inf


def _length_plain(x: np.ndarray, minus: np.ndarray) -> float:
    """Bits of a description of the numbers x (n,) as they are.

    The ends of a converter, 2^k and 2^k - 1, are levels of their own, whose number of digits says all. Bands have the
    largest gap between them, or the `minus` bit (n,) tells them apart.
    """
    levels = np.unique(x)
    gaps = np.diff(levels)
    ends = (np.log2(np.maximum(levels, 1.0)) % 1.0 == 0.0) | (np.log2(levels + 1.0) % 1.0 == 0.0)
    dictionary = np.minimum(np.where(ends, LENGTH + 1.0, np.inf), _digits(np.append(levels[0], gaps))).sum()
    dictionary = min(dictionary, _even(levels))
    bands = []
    for upper in (minus, x > levels[int(np.argmax(gaps))]):
        low, high = x[~upper], x[upper]
        edges = _digits(np.array([low.min(), np.ptp(low), high.min() - low.max(), np.ptp(high)]))
        bands.append(edges.sum() + _bands(x, upper))
    anywhere = _digits(np.array([levels[0], np.ptp(levels)])).sum() + _spread(x)
    from_0 = _digits(levels[-1:]).sum() + len(x) * np.log2(levels[-1] + 1.0)
    return float(min(_walk(x), anywhere, from_0, *bands, dictionary + _choices(len(x), len(levels))))


def _length_signed(x: np.ndarray, minus: np.ndarray) -> float:
    """Bits of a description of the numbers x (n,) with a sign: bands and levels have a size on either side of 0."""
    sides = [np.unique(np.abs(x[side])) for side in (~minus, minus)]
    sizes = np.unique(np.concatenate(sides))
    edges = sum(_digits(np.array([side[0], side[-1] - side[0]])).sum() for side in sides)
    apart = sum(_digits(np.diff(side, prepend=0.0)).sum() for side in sides)
    both = _digits(np.diff(sizes, prepend=0.0)).sum() + len(sizes) * np.log2(3.0)  # each plus, minus or both
    anywhere = _digits(sizes[-1:]).sum() + 0.5 * _spread(np.append(x, -x))
    levels = 1.0 + min(apart, both, _even(np.unique(x))) + _choices(len(x), sum(map(len, sides)))
    return float(min(_walk(x), anywhere, edges + _bands(x, minus), levels))


def _digits(sizes: np.ndarray) -> np.ndarray:
    """Bits of each of these whole numbers from 0 (n,)."""
    return LENGTH + np.log2(sizes + 1.0)


def _even(levels: np.ndarray) -> float:
    """Bits of levels (n,) that are one step apart, infinite for others."""
    gaps = np.diff(levels)
    even = len(levels) > 2 and np.ptp(gaps) == 0.0
    return float(_digits(np.array([abs(levels[0]), gaps[0], len(levels)])).sum()) if even else np.inf


def _choices(n: int, levels: int) -> float:
    """Bits that say which of the levels each number has, none the same as the number before."""
    return float(np.log2(levels) + (n - 1) * np.log2(levels - 1))


def _walk(x: np.ndarray) -> float:
    """Steps of a Cauchy distribution: most are small, and a large one is no wonder."""
    return float(_digits(np.abs(x[:1])).sum()) + _steps(np.abs(np.diff(x)))


def _steps(sizes: np.ndarray) -> float:
    scale = max(float(np.median(sizes)), 1.0) if len(sizes) else 1.0
    return LENGTH + np.log2(scale + 1.0) + float(np.sum(np.log2(np.pi * (scale + sizes**2 / scale))))


def _width(x: np.ndarray) -> float:
    """Bits of one of the numbers, any of their range alike or of a normal distribution."""
    return float(np.log2(1.0 + min(np.ptp(x), np.sqrt(2.0 * np.pi * np.e) * x.std())))


def _spread(x: np.ndarray) -> float:
    return len(x) * _width(x)


def _bands(x: np.ndarray, upper: np.ndarray) -> float:
    """Two bands whose edges are known: each number apart, or a walk from any number at which it enters a band."""
    changes = np.diff(upper)
    values = np.where(upper, _width(x[upper]), _width(x[~upper]))
    walk = _steps(np.abs(np.diff(x))[~changes]) + values[0] + values[1:][changes].sum()
    p = np.clip(changes.mean(), 1e-9, 1.0 - 1e-9)
    turns = -len(changes) * (p * np.log2(p) + (1.0 - p) * np.log2(1.0 - p))
    return float(turns + min(walk, values.sum()))
