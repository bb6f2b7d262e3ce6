"""Wavelet network: a line and a sum of wavelets and scaling functions."""

from dataclasses import dataclass
from math import exp
from typing import ClassVar

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Law, Slot
from sysid.block.compiler.recursion import Map
from sysid.block.symmetry import Symmetry
from sysid.block.writing import Writer


def value(x, p, block):
    y = p.y0 + p.L * x
    for k in range(block.units):
        z = p.b[k] * (x - p.c[k])
        e = exp(-0.5 * z * z)
        if k < block.wavelets:
            e = (1.0 - z * z) * e
        y += p.s[k] * e
    return y


@checked
@dataclass(frozen=True)
class WaveletNetwork(Map):
    """y = y0 + L x + sum_k s_k g_k(b_k (x - c_k)): wavelets g = (1 - z^2) e^(-z^2/2), scaling functions g = e^(-z^2/2).

    The first `wavelets` units are wavelets, the `scaling` ones after them scaling functions (Zhang and Benveniste
    1992, in the toolbox's form). Far from all centres only the line remains.
    """

    functions: ClassVar = {"value": value}
    centred: ClassVar = True

    wavelets: int = 6
    scaling: int = 3

    def __post_init__(self) -> None:
        if min(self.wavelets, self.scaling) < 0 or self.units < 1:
            raise InputError(
                f"a wavelet network of {self.wavelets} wavelets and {self.scaling} scaling functions has no units; "
                "give at least 1 unit"
            )

    @property
    def units(self) -> int:
        """Wavelets and scaling functions together."""
        return self.wavelets + self.scaling

    def slots(self) -> tuple[Slot, ...]:
        n = range(1, self.units + 1)
        return (Slot("y0"), Slot("L"), *(Slot(f"{letter}{k}") for letter in "sbc" for k in n))

    def evaluate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> tuple[np.ndarray, np.ndarray]:
        # By hand: the derived kernel takes 1.5 times as long over a unit's three columns.
        from sysid.block.kernels import wavelet_network

        y, slope = np.empty_like(x), np.empty_like(x)
        wavelet_network(theta, self.wavelets, x, y, slope, J, q, J.shape[1] > 0)
        return y, slope

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        n = self.units
        lines = [f"{w.y} = {w.sum([(theta[0], ''), (theta[1], w.x)])}"]
        for k, (s, b, c) in enumerate(zip(theta[2 : 2 + n], theta[2 + n : 2 + 2 * n], theta[2 + 2 * n :], strict=True)):
            square = f"({w.num(b)}*{w.minus(c)})^2"
            factor = f"(1 - {square})*" if k < self.wavelets else ""
            lines.append(f"  + {w.num(s)}*{factor}exp(-0.5*{square})")
        return lines

    def start(self, x: np.ndarray) -> np.ndarray:
        """The line y = x, with each kind spread over the range of x at weight zero, as wide as its spacing."""
        lo, hi = float(x.min()), float(x.max())
        span = hi - lo if hi > lo else 1.0
        centres, widths = [], []
        for n in (self.wavelets, self.scaling):
            centres.append(lo + span * (np.arange(n) + 0.5) / max(n, 1))
            widths.append(np.full(n, n / span))
        return np.concatenate([[0.0, 1.0], np.zeros(self.units), *widths, *centres])

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        n = self.units
        return Law(self, np.diag(np.repeat([b[0], b[0] / a[0], b[0], 1.0 / a[0], a[0]], [1, 1, n, n, n])))

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        n = self.units
        y0, L, s, b, c = theta[0], theta[1], theta[2 : 2 + n], theta[2 + n : 2 + 2 * n], theta[2 + 2 * n :]
        zero, one = np.zeros(n), np.ones(n)
        return [
            Symmetry(np.concatenate([[0.0, -L], zero, -b, c]), in_scale=1.0),
            Symmetry(np.concatenate([[-L, 0.0], zero, zero, one]), in_shift=1.0),
            Symmetry(np.concatenate([[y0, L], s, zero, zero]), out_scale=1.0),
            Symmetry(np.concatenate([[1.0, 0.0], zero, zero, zero]), out_shift=1.0),
        ]

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        n = self.units
        fresh = theta.copy()
        b = np.abs(theta[2 + n : 2 + 2 * n])
        fresh[2 + n : 2 + 2 * n] *= np.exp(rng.uniform(-1.0, 1.0, n))
        fresh[2 + 2 * n :] += rng.uniform(-1.0, 1.0, n) / np.maximum(b, 1e-12)
        return fresh
