"""Wiener: B/F, then static map."""

from sysid.block import StaticBlock
from sysid.blocks import TransferFunction, static
from sysid.chain import Chain


def wiener(nb: int = 2, nf: int = 3, nk: int = 1, output: str | StaticBlock = "piecewise_linear") -> Chain:
    """y = h(B/F u): linear dynamics before a sensor's map."""
    return Chain((TransferFunction(nb, nf, nk, role="linear"), static(output, "output")), structure="wiener")
