"""Coupled drives: two motors that drive one belt on springs, whose speed is read without its sign."""

from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.base.checks import checked
from sysid.blocks import BowedGain, FrictionLag, Rectifier, TransferFunction
from sysid.model.chain import Chain
from sysid.model.recipes import Recipe, beside, order

GAIN = 0.15  # of the drive; the belt has a gain of its own


@checked
def coupled_drives(nb: int = 2, nf: int = 2, nk: int = 1, **limits: Any) -> Chain:
    """Voltage, its gain bowed -> drive with dry friction -> belt B/F -> rectifier with an offset -> filter of a pole.

    The plant and its records: Wigren and Schoukens, "Coupled electric drives data set and reference models", Uppsala
    University, technical report 2017-024. Of 24 chains (one or two zeros, delay 0 or 1, each of bow, offset and filter
    there or not) this one has the least BIC on the training records; every one was searched from four points. The
    automatic start has the size of that plant: volts, and ticks per second. `limits` are the `fixed` and `bounds` of
    the chain, by parameter.
    """
    blocks = (
        BowedGain(role="driver"),
        FrictionLag(role="drive"),
        TransferFunction(nb, nf, nk, role="belt"),
        Rectifier(role="rectifier"),
        TransferFunction(1, 1, 0, role="sensor"),
    )
    fixed = beside({"drive.gain": GAIN}, limits.pop("fixed", None))
    return Chain(blocks, structure="coupled_drives", fixed=fixed, **limits)


@checked
@dataclass(frozen=True)
class CoupledDrives(Recipe):
    """Settings of `coupled_drives`; the orders are those of the belt."""

    name: ClassVar[str] = "coupled_drives"
    searched: ClassVar[bool] = True
    rungs: ClassVar = ({"nb": 2, "nf": 2},)
    zero: ClassVar[str] = "volts and speeds"
    nb: int = order(2, "zeros + 1", least=1)
    nf: int = order(2, "poles", least=2)
    nk: int = order(1, "delay in samples")

    def model(self) -> Chain:
        return coupled_drives(self.nb, self.nf, self.nk)
