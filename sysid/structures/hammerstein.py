"""Hammerstein: static map, then B/F."""

from sysid.block import StaticBlock
from sysid.blocks import TransferFunction, static
from sysid.chain import Chain


def hammerstein(nb: int = 2, nf: int = 3, nk: int = 1, input: str | StaticBlock = "piecewise_linear") -> Chain:
    """y = B/F f(u): an actuator's map before linear dynamics."""
    return Chain((static(input, "input"), TransferFunction(nb, nf, nk, role="linear")), structure="hammerstein")
