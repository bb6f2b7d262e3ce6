"""Normal units: a fit takes place where input and output have a spread near 1, whatever the units of its record.

Searches and starts have limits and shares that suit such signals. A power of two for each signal rounds nothing, so
that a record in other units gives the same fit: to the bit for powers of two.
"""

from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import IOData
from sysid.estimation.objective import Objective
from sysid.estimation.problem import ChainProblem
from sysid.model.chain import Chain
from sysid.model.units import rescaled
from sysid.solver.iterate import Outcome

_LEAST = 0.55  # spread in normal units: from here to twice as much, so that plain test signals stay as they are


@dataclass(frozen=True)
class Normal:
    """A chain and a record in normal units, and the way back: theta = M theta there, y = size y there."""

    chain: Chain
    data: IOData
    M: np.ndarray
    size: float

    @classmethod
    def of(cls, chain: Chain, data: IOData, objective: Objective) -> "Normal":
        """The chain and the record in the normal units that the chain's blocks have laws for.

        A ridge is in the units of the record by its definition, so that with one all stays as it is.
        """
        u, y = np.array([unit_of(column) for column in data.u.T]), largest_unit(data)
        if not objective.ridge:
            for a, b in ((u, y), (np.ones_like(u), y), (u, 1.0)):
                found = rescaled(chain, a, np.full(data.y.shape[1], b))
                if found is not None:
                    return cls(found.chain, replace(data, u=data.u / a, y=data.y / b), found.M, abs(b))
        return cls.kept(chain, data)

    @classmethod
    def kept(cls, chain: Chain, data: IOData) -> "Normal":
        """The units of the record."""
        return cls(chain, data, np.eye(len(chain.names)), 1.0)

    def back(self, chain: Chain, data: IOData, problem: ChainProblem, outcome: Outcome) -> tuple[ChainProblem, Outcome]:
        """A problem and the end of its search as those of the chain and record in their own units."""
        thetas = problem.thetas(outcome.p) @ self.M.T
        own = replace(
            problem,
            chain=chain,
            theta0=thetas,
            records=data.experiments,
            huber_threshold=problem.huber_threshold * self.size,
            curvature_weight=problem.curvature_weight * self.size,
            scratch={},
        )
        history = tuple({**row, "loss": row["loss"] * self.size**2} for row in outcome.history)
        return own, replace(outcome, p=own.start, cost=outcome.cost * self.size**2, history=history)


def unit_of(x: np.ndarray) -> float:
    """The power of two that brings the spread of x (N,) to `_LEAST` or up to twice as much; 1 of a constant."""
    with np.errstate(over="ignore", under="ignore"):
        middle = float(np.abs(x).max(initial=0.0))
        size = float(np.std(x / middle)) * middle if middle > 0.0 else 0.0
    return float(2.0 ** np.floor(np.log2(size / _LEAST))) if size > 0.0 else 1.0


def largest_unit(data: IOData) -> float:
    """The unit of the output that varies most: errors of several outputs add up in one unit."""
    columns = [column[seen] for column, seen in zip(data.y.T, data.observed.T, strict=True)]
    varied = [column for column in columns if len(column) and np.ptp(column) > 0.0]
    return max((unit_of(column) for column in varied), default=1.0)
