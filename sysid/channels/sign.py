"""The sign of a word that was logged without it: two's complement, or one bit for the sign beside the magnitude."""

import numpy as np

FEWEST_BITS = 7  # of a magnitude: a byte with a sign
# Times the largest step within one sign. On drawn words 99 % of the signs are found; without JUMP 14 of 4,000 drawn
# signals without a sign are taken for words, with it 3; with ALIKE = 1 a third of the signs are missed.
JUMP, ALIKE = 1.5, 2.0


def with_sign(x: np.ndarray, bits: int, sign_bit: int) -> tuple[np.ndarray, np.ndarray]:
    """The words x (n,) with their sign, and which of them are none of this kind.

    `bits` are those of two's complement; `sign_bit` is the place, from 0, of the bit that says minus.
    """
    half = 2.0**sign_bit if sign_bit else 2.0 ** (bits - 1)
    lowest = 0.0 if sign_bit else -half
    bad = np.isfinite(x) & ((x < lowest) | (x >= 2.0 * half) | (x != np.rint(x)))
    return np.where(x >= half, half - x if sign_bit else x - 2.0 * half, x), bad


def sign_bit_of(x: np.ndarray) -> int:
    """The bit that is the sign of whole numbers x (n,), if the record shows one, else 0.

    Then the steps at which the highest bit changes are the largest of the numbers as they are, and like the others once
    the bit is a sign; and it stays for some samples, which a glitch does not.
    """
    x = x[np.isfinite(x)]
    if len(x) < 3 or x.min() < 0 or np.any(x != np.rint(x)) or x.max() < 2.0**FEWEST_BITS or x.max() >= 2.0**32:
        return 0
    bit = int(np.log2(x.max()))
    minus = x >= 2.0**bit
    steps, changes = np.abs(np.diff(x)), np.diff(minus)
    signed_steps = np.abs(np.diff(with_sign(x, 0, bit)[0]))
    if changes.all() or not changes.any() or not np.any(minus[:-2] & minus[1:-1] & minus[2:]):
        return 0
    largest = steps[~changes].max()
    jumps, goes_on = steps[changes].min() > JUMP * largest, signed_steps[changes].max() <= ALIKE * largest
    return bit if jumps and goes_on else 0
