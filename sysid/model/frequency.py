"""The frequency response of a chain of one linear block, with its exact gradient in theta."""

import numpy as np

from sysid.base.errors import InputError
from sysid.blocks import Predictor, Process, TransferFunction
from sysid.blocks.offset import is_offset
from sysid.model.chain import Chain
from sysid.model.tangents import transfer


def linear_block(chain: Chain) -> Process | TransferFunction:
    """The one block of the chain that has a frequency response of its own; raises InputError for other chains."""
    blocks = [b for b in chain.blocks if not is_offset(b)]
    if len(blocks) != 1 or not isinstance(blocks[0], Process | TransferFunction) or isinstance(blocks[0], Predictor):
        raise InputError(
            f"frequency data are fitted by process and output_error with one input and one output, not by "
            f"{chain.structure or 'this chain'}; choose one of the two"
        )
    return blocks[0]


@np.errstate(all="ignore")  # far from every plant; its cost is then infinite
def response(chain: Chain, theta: np.ndarray, w: np.ndarray, Ts: float | None) -> tuple[np.ndarray, np.ndarray]:
    """The response (n,) at w (n,) [rad/s], and its gradient (n, P): of samples of Ts [s] of a held input, or
    of continuous signals.

    Raises InputError for a transfer function in samples without their time.
    """
    block = linear_block(chain)
    if Ts is None:
        if not isinstance(block, Process):
            raise InputError(
                "the coefficients of output_error count in samples, and these data have no sampling time; give Ts "
                "(--ts), or choose process"
            )
        return _continuous(chain, theta, block, 1j * w)
    G = transfer(chain, theta, block)
    powers = np.exp(-1j * Ts * np.outer(w, np.arange(max(len(G.B), len(G.F)))))
    B, F = powers[:, : len(G.B)], powers[:, : len(G.F)]
    value = (B @ G.B) / (F @ G.F)
    return value, (B @ G.B_gradient - value[:, None] * (F @ G.F_gradient)) / (F @ G.F)[:, None]


def _continuous(chain: Chain, theta: np.ndarray, block: Process, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The process at s (n,), without a hold."""
    part, m = chain.index(block), block.by_name(theta[chain.index(block)])
    unit, slopes = np.exp(-s * m.get("Td", 0.0)), {"Td": -s}  # of the logarithm
    for name in ("T1", "T2", "T3"):
        if name in m:
            factor = 1.0 + m[name] * s
            unit, slopes[name] = unit / factor, -s / factor
    if block.pair:
        x, zeta = s / m["wn"], m["zeta"]
        factor = 1.0 + 2.0 * zeta * x + x * x
        unit, slopes["zeta"] = unit / factor, -2.0 * x / factor
        slopes["wn"] = (2.0 * zeta * x + 2.0 * x * x) / factor / m["wn"]
    if block.zero:
        factor = 1.0 + m["Tz"] * s
        unit, slopes["Tz"] = unit * factor, s / factor
    unit = unit / s if block.integrator else unit
    gradient = np.zeros((len(s), len(theta)), dtype=complex)
    for k, slot in enumerate(block.slots()):
        if slot.name == "K":
            gradient[:, part.start + k] = unit
        elif slot.name in slopes:
            gradient[:, part.start + k] = m["K"] * unit * slopes[slot.name]
    return m["K"] * unit, gradient
