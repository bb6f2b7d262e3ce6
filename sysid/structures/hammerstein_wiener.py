"""Hammerstein-Wiener: static map, B/F, static map."""

from sysid.block import StaticBlock
from sysid.blocks import TransferFunction, static
from sysid.chain import Chain


def hammerstein_wiener(
    nb: int = 2,
    nf: int = 3,
    nk: int = 1,
    input: str | StaticBlock = "piecewise_linear",
    output: str | StaticBlock = "piecewise_linear",
) -> Chain:
    """y = h(B/F f(u)), equations (3) to (5) of Guni and Irawan 2016; the defaults are the toolbox's.

    It cannot hold an end stop of an integrating plant: its memory is linear.
    """
    blocks = (static(input, "input"), TransferFunction(nb, nf, nk, role="linear"), static(output, "output"))
    return Chain(blocks, structure="hammerstein_wiener")
