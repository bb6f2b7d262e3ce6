"""The interface of a block (slots, tangent, symmetries) and its compiled loops."""

from sysid.base import modules_of
from sysid.block.block import Block, Slot, StaticBlock
from sysid.block.symmetry import Symmetry

__all__ = ["Block", "Slot", "StaticBlock", "Symmetry"]

__getattr__, __dir__ = modules_of(__name__)
