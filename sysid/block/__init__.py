"""What a block is: slots, tangent, symmetries; and the compiled loops under it."""

from sysid.block.block import Block, Slot, StaticBlock, Symmetry

__all__ = ["Block", "Slot", "StaticBlock", "Symmetry"]
