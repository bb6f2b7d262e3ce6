"""How large a number of anything may be, with the reason: beyond it a sentence stands in for a full memory or a hang.

Each limit lies far beyond what a record, a model or a machine of today needs. `BY_NAME` says which limit an argument of
a public call has; `sysid.base.checks` looks there.
"""

import math
from collections.abc import Mapping

from sysid.base.errors import InputError
from sysid.base.kinds import Span

SEED = 2**63 - 1  # tables and files keep a seed in 64 bits with a sign
SAMPLES = 10**8  # of a record: 0.8 GB for each channel, before any work is done with it
MOST = 10**15  # of a count that nothing is stored for
STEPS = 10**9  # of the simulation's clock: 11.6 days of a twin that steps every millisecond, days of work
ORDER = 1000  # of a transfer function; a polynomial of degree 100 already has no useful digits
DELAY = 10**5  # samples of dead time; each is a name and a parameter where a model has initial states
PIECES = 10**4  # knots, units or powers of one block: a covariance of as many parameters takes 0.8 GB
CHANNELS = 1000
STARTS = 10**5  # each is a search
MORE_STARTS = 20  # that a sentence proposes where a search did not agree or converge
ITERATIONS = 10**7
PROCESSES = 1024  # threads or processes; the largest machines have some hundred cores
DRAWS = 10**6  # of an uncertainty; each is a simulation of the record
POINTS = 10**7  # of a curve or a response
LAGS = 10**6
SECONDS = 1e12  # a time in seconds: 30,000 years


COUNT = Span(1, PIECES)
FROM_ZERO = Span(0, PIECES)
BOUND = Span(-math.inf, math.inf, infinite=True)
LENGTH = Span(0, SECONDS, above=True)

BY_NAME: Mapping[str, Span] = {
    "Ts": LENGTH,
    "bits": Span(1, 64),
    "bounds": BOUND,
    "curvature_weight": Span(0),
    "deadline": Span(infinite=True),
    "degree": FROM_ZERO,
    "digits": Span(1, 17),
    "draws": Span(0, DRAWS),
    "duration": LENGTH,
    "folds": Span(-STARTS, STARTS),  # the lowest one is said by the call
    "horizon": Span(1, SAMPLES),
    "jobs": Span(1, PROCESSES),
    "knots": FROM_ZERO,
    # Of confidence: at 1 every band is infinite.
    "level": Span(0.0, 1.0 - 1e-9, above=True, say="a probability between 0 and 1, for example 0.95"),
    "lower": BOUND,
    "max_halvings": Span(0, 1000),
    "max_iterations": Span(0, ITERATIONS),
    "max_lag": Span(1, LAGS),
    "max_seconds": Span(0, SECONDS, infinite=True),
    "N": Span(1, SAMPLES),
    "n_init": Span(0, SAMPLES),
    "na": Span(0, ORDER),
    "nb": Span(0, ORDER),
    "nb2": Span(0, ORDER),
    "nc": Span(0, ORDER),
    "nd": Span(0, ORDER),
    "nf": Span(0, ORDER),
    "nf2": Span(0, ORDER),
    "nk": Span(0, DELAY),
    "nk2": Span(0, DELAY),
    "nu": Span(1, CHANNELS),
    "number": Span(0, SAMPLES),
    "nx": Span(1, ORDER),
    "ny": Span(1, CHANNELS),
    "part": Span(1, SAMPLES),
    "period": Span(0, SECONDS),
    "points": Span(2, POINTS),
    "ridge": Span(0),
    "samples": Span(1, POINTS),
    "scaling": FROM_ZERO,
    "seconds": Span(0, SECONDS, above=True, infinite=True),
    "seed": Span(0, SEED),
    "starts": Span(1, STARTS),
    "substeps": Span(1, PIECES),
    "threads": Span(0, PROCESSES),
    "tolerance": Span(0),
    "units": FROM_ZERO,
    "updates": Span(1, PIECES),
    "upper": BOUND,
    "wavelets": FROM_ZERO,
}

OF_EACH = ("bounds", "lower", "upper")  # lists and dicts with that limit for each entry; others have none by name


def check_steps(what: str, count: float, most: int = SAMPLES) -> None:
    """Raises InputError for a number of samples or steps beyond `most`; `what` names them."""
    if not count <= most:
        raise InputError(f"{what} comes to {count:g} samples; give a time of at most {most:,} of them")
