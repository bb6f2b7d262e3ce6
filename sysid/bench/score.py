"""One case -> one flat row of numbers."""

import numpy as np

from sysid.base.criteria import fit_percent
from sysid.bench.scenarios import NOISE, Case, N, chain
from sysid.model.system import System
from sysid.nlarx.dispatch import fit
from sysid.systems import system
from sysid.uncertainty.information import information_at
from sysid.uncertainty.intervals import poles

FIELDS = (
    "plant", "structure", "starts", "seed", "fit", "oracle", "gap", "pole_errors_crb", "seconds", "iterations",
    "evaluations", "converged",
)  # fmt: skip


def score(case: Case) -> dict[str, str]:
    """Fit one record, score a second of the same kind. Errors of poles are |error| over the Cramer-Rao bound.

    The bound belongs to the plant's own structure at the truth, for any fitted structure. There is one number for each
    pole in the plant's order, from the nearest estimated pole. `oracle` is the fit [%] of the true parameters.
    """
    plant = system(case.plant)
    rng = np.random.default_rng([case.seed, 77])
    estimation, validation = plant.record(N, NOISE, rng), plant.record(N, NOISE, rng)
    found = fit(chain(case.structure, plant), estimation, starts=case.starts, seed=case.seed)
    n = found.n_init
    oracle = fit_percent(validation.y[n:, 0], plant.truth(validation.u[:, 0])[n:])
    free_run = found.fit_percent(validation)
    bound = pole_bound(plant, estimation.u[:, 0])
    errors = [float(np.abs(found.poles - z).min()) / b for z, b in zip(plant.poles, bound, strict=True)]
    values = {
        "fit": f"{free_run:.6f}",
        "oracle": f"{oracle:.6f}",
        "gap": f"{oracle - free_run:.6f}",
        "pole_errors_crb": ";".join(f"{e:.4f}" for e in errors),
        "seconds": f"{found.seconds:.4f}",
        "iterations": str(found.stop.iterations),
        "evaluations": str(found.stop.evaluations),
        "converged": str(int(found.stop.converged)),
    }
    return {**{k: str(v) for k, v in vars(case).items()}, **values}


def pole_bound(plant: System, u: np.ndarray) -> np.ndarray:
    """Cramer-Rao bound on sqrt(E |error|^2) of each pole, for this input and the noise of the scenarios."""
    from sysid.data.record import IOData

    y = plant.truth(u)
    data = IOData(u, y, plant.Ts)
    info = information_at(plant.chain, plant.theta, data, noise_variance=(NOISE * float(y.std())) ** 2)
    return np.array([r.std for r in poles(info)])
