"""Linear block of several inputs and outputs: a matrix of B/F with separate orders, delays and initial states."""

from dataclasses import dataclass, replace

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Block, Law, Slot
from sysid.block.symmetry import Symmetry, block_diagonal
from sysid.blocks.transfer_function import TransferFunction


@checked
@dataclass(frozen=True)
class TransferMatrix(Block):
    """x_j = sum_i B_ji/F_ji w_i; entries[j][i] leads from input i to output j. Parameters are named '1,2.b0', ...

    Entries of one output with equal poles have redundant initial states; the pseudo-inverse of the covariance handles
    these directions.
    """

    entries: tuple[tuple[TransferFunction, ...], ...] = ()

    def __post_init__(self) -> None:
        if not self.entries or len({len(row) for row in self.entries}) != 1 or not self.entries[0]:
            raise InputError("a transfer matrix needs rows of equal length; give entries[output][input]")

    @property
    def channels(self) -> tuple[int, int]:
        return len(self.entries[0]), len(self.entries)

    def _flat(self) -> list[tuple[int, int, TransferFunction]]:
        return [(j, i, entry) for j, row in enumerate(self.entries) for i, entry in enumerate(row)]

    def slots(self) -> tuple[Slot, ...]:
        return tuple(
            replace(s, name=f"{j + 1},{i + 1}.{s.name}") for j, i, entry in self._flat() for s in entry.slots()
        )

    def parts(self) -> list[tuple[slice, Block]]:
        entries: list[tuple[slice, Block]] = []
        end = 0
        for _, _, entry in self._flat():
            entries.append((slice(end, end + entry.n_parameters), entry))
            end += entry.n_parameters
        return entries

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        return self.propagate_all(theta, [x], [J], q)[0][0]

    def propagate_all(
        self, theta: np.ndarray, xs: list[np.ndarray], Js: list[np.ndarray], q: int
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        if len(xs) != self.channels[0]:
            raise InputError(f"{len(xs)} inputs meet a matrix of {self.channels[0]}; give as many as it has columns")
        ys = [np.zeros_like(xs[0]) for _ in self.entries]
        out = [np.zeros_like(Js[0]) for _ in self.entries]
        for (j, i, entry), (part, _) in zip(self._flat(), self.parts(), strict=True):
            J = Js[i].copy()  # every entry filters the same tangent in its own way
            ys[j] += entry.propagate(theta[part], xs[i], J, q + part.start)
            out[j] += J
        return ys, out

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.concatenate([entry.start(x) for _, _, entry in self._flat()])

    def admissible(self, theta: np.ndarray) -> bool:
        return all(entry.admissible(theta[part]) for part, entry in self.parts())

    def repair(self, theta: np.ndarray) -> np.ndarray:
        return np.concatenate([entry.repair(theta[part]) for part, entry in self.parts()])

    def at_low(self, theta: np.ndarray) -> np.ndarray:
        return np.concatenate([entry.at_low(theta[part]) for part, entry in self.parts()])

    def basis(self) -> np.ndarray:
        M = np.eye(self.n_parameters)
        for part, entry in self.parts():
            M[part, part] = entry.basis()
        return M

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        laws = [entry.law(a[[i]], b[[j]]) for j, i, entry in self._flat()]
        return Law(self, block_diagonal(*(own.M for own in laws if own is not None)))

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        """Gains and offsets of each input and output, over all entries connected to it."""
        n_in, n_out = self.channels
        tables = [[entry.symmetries(theta[part]) for part, entry in self._row(j)] for j in range(n_out)]
        changes = []
        for i in range(n_in):
            unit = np.eye(n_in)[i]
            changes.append(Symmetry(self._gather(theta, {(j, i): tables[j][i][0].d_theta for j in range(n_out)}), unit))
            if all(len(tables[j][i]) > 2 for j in range(n_out)):
                shifts = [tables[j][i][2] for j in range(n_out)]
                if all(abs(float(s.in_shift)) > 1e-12 for s in shifts):  # an integrator has no constant gain to share
                    parts = {(j, i): s.d_theta / s.in_shift for j, s in enumerate(shifts)}
                    gains = np.array([s.out_shift / s.in_shift for s in shifts])
                    changes.append(Symmetry(self._gather(theta, parts), in_shift=unit, out_shift=gains))
        for j in range(n_out):
            parts = {(j, i): tables[j][i][1].d_theta for i in range(n_in)}
            changes.append(Symmetry(self._gather(theta, parts), out_scale=np.eye(n_out)[j]))
        return changes

    def _row(self, j: int) -> list[tuple[slice, Block]]:
        n = self.channels[0]
        return self.parts()[j * n : (j + 1) * n]

    def _gather(self, theta: np.ndarray, parts: dict[tuple[int, int], np.ndarray]) -> np.ndarray:
        wide = np.zeros(len(theta))
        for (j, i), d_theta in parts.items():
            wide[self._row(j)[i][0]] = d_theta
        return wide

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return np.concatenate([entry.vary(theta[part], rng) for part, entry in self.parts()])
