"""Static maps side by side: one for each channel of a chain with several inputs or outputs."""

from dataclasses import dataclass, replace

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Block, Law, Slot, StaticBlock
from sysid.block.symmetry import Symmetry, block_diagonal


@checked
@dataclass(frozen=True)
class Channels(Block):
    """maps[i] applies to channel i; parameters are named '1.x1', '2.x1', ..."""

    maps: tuple[StaticBlock, ...] = ()

    def __post_init__(self) -> None:
        if not self.maps:
            raise InputError("channels need at least one map; give one for each channel")

    def slots(self) -> tuple[Slot, ...]:
        return tuple(replace(s, name=f"{i}.{s.name}") for i, m in enumerate(self.maps, 1) for s in m.slots())

    @property
    def channels(self) -> tuple[int, int]:
        return len(self.maps), len(self.maps)

    def parts(self) -> list[tuple[slice, Block]]:
        ends = np.cumsum([m.n_parameters for m in self.maps])
        return [(slice(int(e) - m.n_parameters, int(e)), m) for e, m in zip(ends, self.maps, strict=True)]

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        return self.propagate_all(theta, [x], [J], q)[0][0]

    def propagate_all(
        self, theta: np.ndarray, xs: list[np.ndarray], Js: list[np.ndarray], q: int
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        if len(xs) != len(self.maps):
            raise InputError(f"{len(xs)} channels meet {len(self.maps)} maps; give one map for each channel")
        ys = [
            m.propagate(theta[part], x, J, q + part.start) for (part, m), x, J in zip(self.parts(), xs, Js, strict=True)
        ]
        return ys, Js

    def start(self, x: np.ndarray) -> np.ndarray:
        return np.concatenate([m.start(x) for m in self.maps])

    def admissible(self, theta: np.ndarray) -> bool:
        return all(m.admissible(theta[part]) for part, m in self.parts())

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return np.concatenate([m.vary(theta[part], rng) for part, m in self.parts()])

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        laws = [m.law(a[[i]], b[[i]]) for i, m in enumerate(self.maps)]
        complete = [law for law in laws if law is not None]
        if len(complete) < len(laws):
            return None
        maps = tuple(law.block for law in complete)
        return Law(replace(self, maps=maps), block_diagonal(*(law.M for law in complete)))  # type: ignore[arg-type]

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        changes = []
        for i, (part, m) in enumerate(self.parts()):
            unit = np.zeros(len(self.maps))
            unit[i] = 1.0
            for s in m.symmetries(theta[part]):
                wide = np.zeros(len(theta))
                wide[part] = s.d_theta
                changes.append(
                    Symmetry(wide, s.in_scale * unit, s.in_shift * unit, s.out_scale * unit, s.out_shift * unit)
                )
        return changes
