"""Speed: single start, multi-start, time and memory over N, and the bare simulate-and-Jacobian kernel.

Times are processor seconds of one core, warm, the shortest of several runs, so that other processes matter little and
other cores do not matter. Compare ratios across machines.
"""

import resource
import sys
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from sysid.base.parallel import one_blas_thread
from sysid.bench.scenarios.textbook import NOISE, N
from sysid.estimation.problem import ChainProblem
from sysid.fitting import fit
from sysid.model.chain import Chain
from sysid.model.system import System
from sysid.solver.linearisation import Linearisation
from sysid.structures import hammerstein_wiener
from sysid.systems import system

T = TypeVar("T")


def speed(long: int = 1_000_000, plant: str = "textbook") -> dict[str, float]:
    """Seconds [s], ratios [-] and memory [GiB] on the default Hammerstein-Wiener of ten break points a map."""
    true = system(plant)
    linear = true.chain.linear
    model = hammerstein_wiener(linear.nb, linear.nf, linear.nk)
    data = true.record(N, NOISE, np.random.default_rng(0))
    u = data.u[:, 0]
    fit_result = fit(model, data, starts=1)
    single, count = _best(lambda: fit(model, data, starts=1), 5)
    multi, _ = _best(lambda: fit(model, data, starts=5), 3)
    kernel, _ = _best(lambda: model.tangent(fit_result.theta, u), 50)
    free_run, _ = _best(lambda: model.simulate(fit_result.theta, u), 50)
    short_time = _per_sample(true, model, 10_000, fit_result.theta)
    long_time = _per_sample(true, model, long, fit_result.theta)
    fit(model, true.record(long, NOISE, np.random.default_rng(1)), starts=1, start=fit_result.theta)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**30 if sys.platform == "darwin" else 2**20)
    return {
        "single_start_s": single,
        "iterations": float(count.stop.iterations),
        "multi_start_5_s": multi,
        "simulate_s": free_run,
        "simulate_and_jacobian_s": kernel,
        "parameters": float(len(fit_result.theta)),
        "single_start_over_kernel": single / kernel,
        "us_per_sample_iteration_10000": 1e6 * short_time,
        f"us_per_sample_iteration_{long}": 1e6 * long_time,
        "ratio_per_sample": long_time / short_time,
        "peak_memory_GiB": peak,
    }


def _per_sample(true: System, model: Chain, n: int, theta: np.ndarray) -> float:
    """Seconds per sample of one iteration of a search: Jacobian, QR and one trial step."""
    data = true.record(n, NOISE, np.random.default_rng(1))
    problem = ChainProblem.least_squares(model, theta, data.u[:, 0], data.y[:, 0])

    def job() -> None:
        Linearisation.of(*problem.linearise(problem.start))
        problem.residual(problem.start)

    job()
    with one_blas_thread():
        return _best(job, 20 if n <= 10_000 else 5)[0] / n


def _best(job: Callable[[], T], repeats: int) -> tuple[float, T]:
    """Shortest time of several runs, and the result of the last one."""
    shortest = np.inf
    for _ in range(repeats):
        began = time.process_time()
        result = job()
        shortest = min(shortest, time.process_time() - began)
    return shortest, result
