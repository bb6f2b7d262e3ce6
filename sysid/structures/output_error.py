"""Output error: B/F alone."""

from sysid.blocks import TransferFunction
from sysid.chain import Chain


def output_error(nb: int = 2, nf: int = 3, nk: int = 1) -> Chain:
    """y = B/F u with white noise at the output. It has no offset: take the means off first."""
    return Chain((TransferFunction(nb, nf, nk, role="linear"),), structure="output_error")
