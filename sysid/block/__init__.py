"""The interface of a block (slots, tangent, symmetries) and its compiled loops."""

from sysid.block.block import Block, Slot, StaticBlock, Symmetry

__all__ = ["Block", "Slot", "StaticBlock", "Symmetry"]
