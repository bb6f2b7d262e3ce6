"""Normal units: a fit takes place where input and output have a spread near 1, whatever the units of its record.

Where a map can take up the mean of the signal at its end of the chain, it is taken off (`sysid.model.transforms`).

Searches and starts have limits and shares that suit such signals. A power of two for each signal rounds nothing, so
that a record in other units gives the same fit: to the bit for powers of two. A unit is negative where its signal is
the mirror image of the one that is fitted (`sysid.block.symmetry`), so that a record and the same one with a signal of
the other sign are one record there. Chains that have no law for a sign (functions of the user's own, blocks with
physical numbers) keep that of the record: nothing is promised for their mirror images.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from sysid.block.symmetry import direction
from sysid.data.record import IOData
from sysid.estimation.objective import Objective
from sysid.estimation.problem import ChainProblem
from sysid.model.chain import Chain
from sysid.model.transforms import rescale, shift
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Outcome

_MANY = 8  # channels: the signs of more are not tried
_LEAST = 0.55  # spread in normal units: from here to twice as much, so that plain test signals stay as they are


@dataclass(frozen=True)
class Normal:
    """A chain and a record in normal units, and the way back: theta = M theta there + m, errors = size errors there."""

    chain: Chain
    data: IOData
    M: np.ndarray
    m: np.ndarray
    size: float

    @classmethod
    def choose(cls, chain: Chain, data: IOData, objective: Objective) -> "Normal":
        """The chain and the record in the normal units that the chain's blocks have laws for.

        A ridge is in the units of the record by its definition, so that with one all stays as it is.
        """
        u, y = np.array([unit_of(column) for column in data.u.T]), np.full(data.y.shape[1], largest_unit(data))
        if not objective.ridge:
            for a, b in ((u, y), (np.ones_like(u), y), (u, np.ones_like(y))):
                normal = _rescale_and_mirror(chain, data, a, b)
                if normal is not None:
                    return normal
        return cls.keep(chain, data)

    @classmethod
    def keep(cls, chain: Chain, data: IOData) -> "Normal":
        """The units of the record."""
        return cls(chain, data, np.eye(len(chain.names)), np.zeros(len(chain.names)), 1.0)

    def restore(
        self, chain: Chain, data: IOData, problem: ChainProblem, outcome: Outcome
    ) -> tuple[ChainProblem, Outcome]:
        """A problem and the end of its search as those of the chain and record in their own units."""
        thetas = problem.thetas(outcome.p) @ self.M.T + self.m
        original = replace(
            problem,
            chain=chain,
            theta0=thetas,
            records=data.experiments,
            prior=None if problem.prior is None else problem.prior.moved(self.M, self.m, self.size),
            huber_threshold=problem.huber_threshold * self.size,
            curvature_weight=problem.curvature_weight * self.size,
            scratch={},
        )
        history = tuple({**row, "loss": row["loss"] * self.size**2} for row in outcome.history)
        return original, replace(outcome, p=original.start, cost=outcome.cost * self.size**2, history=history)

    def covariance(self, cov_normal: Covariance) -> Covariance:
        """The covariance of theta in the units of the record, with the same directions left out."""
        M = self.M
        lost = np.abs(M) @ cov_normal.unidentifiable > 0.0
        with np.errstate(over="ignore", invalid="ignore"):  # of a parameter that hardly any sample shows
            cov = M @ cov_normal.cov @ M.T
        return Covariance(cov, lost, cov_normal.noise_variance * self.size**2, np.abs(M) @ cov_normal.bounded > 0.0)


def _rescale_and_mirror(chain: Chain, data: IOData, a: np.ndarray, b: np.ndarray) -> Normal | None:
    """The chain and the record in units of these sizes, with signs that the chain has laws for; None if it has none.

    The signs that it takes are a group. Of all mirror images of the record that the group makes, the first one in a
    fixed order of their directions is the one for the fit, whichever of them the record is.
    """
    if rescale(chain, a, b) is None:
        return None
    directions, nu = np.array([*map(direction, data.u.T), *map(direction, observed_samples(data))]), len(a)
    images = product((1.0, -1.0), repeat=len(directions)) if len(directions) <= _MANY else (tuple(directions),)
    for signs in (directions * np.array(image) for image in images):
        rescaling = rescale(chain, a * signs[:nu], b * signs[nu:])
        if rescaling is not None:
            u, y = data.u / (a * signs[:nu]), data.y / (b * signs[nu:])
            means = [float(np.mean(part)) if len(part) else 0.0 for part in observed_samples(replace(data, y=y))]
            law = shift(rescaling.chain, np.mean(u, axis=0), np.array(means))
            # Without a zero of its own sign: the image of a record is that record, also where a kernel divides.
            normal_data = replace(data, u=u - law.input + 0.0, y=y - law.output + 0.0)
            return Normal(rescaling.chain, normal_data, rescaling.M @ law.M, rescaling.M @ law.m, float(b[0]))
    return None


def observed_samples(data: IOData) -> list[np.ndarray]:
    """The measured samples of each output."""
    return [column[mask] for column, mask in zip(data.y.T, data.observed.T, strict=True)]


def unit_of(x: np.ndarray) -> float:
    """The power of two that brings the spread of x (N,) to `_LEAST` or up to twice as much; 1 of a constant."""
    with np.errstate(over="ignore", under="ignore"):
        middle = float(np.abs(x).max(initial=0.0))
        size = float(np.std(x / middle)) * middle if middle > 0.0 else 0.0
    return float(2.0 ** np.floor(np.log2(size / _LEAST))) if size > 0.0 else 1.0


def largest_unit(data: IOData) -> float:
    """The unit of the output that varies most: errors of several outputs add up in one unit."""
    varying = [column for column in observed_samples(data) if len(column) and np.ptp(column) > 0.0]
    return max((unit_of(column) for column in varying), default=1.0)
