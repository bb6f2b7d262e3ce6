"""The free run of a chain in pieces of the record, so that memory does not grow with its length."""

from collections.abc import Iterator

import numpy as np

from sysid.model.chain import Chain

LONG = 40_000  # samples from which a record is taken in pieces
ROWS = 4096  # samples of a piece: its Jacobian stays in a processor's cache


def in_pieces(chain: Chain) -> bool:
    """True if every block of the chain can carry its state from one piece to the next."""
    none = (b.piecewise(np.zeros(b.n_parameters), 0, 0) is None for b in chain.blocks)
    return all(b.channels == (1, 1) for b in chain.blocks) and not any(none)


def pieces(
    chain: Chain, theta: np.ndarray, u: np.ndarray, tangent: bool
) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """Rows of the record u (N, 1), their outputs (n, 1) and Jacobian (n, P), which the next piece overwrites.

    Without `tangent` the Jacobian is (n, 0).
    """
    P = len(theta) if tangent else 0
    runs, q = [], 0
    for b in chain.blocks:
        run = b.piecewise(chain.part(theta, b), q, P)
        assert run is not None  # see `in_pieces`
        runs.append(run)
        q += b.n_parameters
    x0, room = np.ascontiguousarray(u[:, 0]), np.empty((min(ROWS, len(u)), P))
    for start in range(0, len(u), ROWS):
        rows = slice(start, min(start + ROWS, len(u)))
        x, J = x0[rows], room[: rows.stop - start]
        with np.errstate(over="ignore", invalid="ignore"):  # an unstable trial overflows; its cost is then infinite
            for run in runs:
                x = run(x, J)
        yield rows, x[:, None], J
