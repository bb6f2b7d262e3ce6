"""Identification of block-oriented nonlinear systems: Hammerstein-Wiener and its relatives, checked against truth.

Names load on first use, so that `import sysid` stays light; `__init__.pyi` lists them.
"""

import os
import sys

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)


def _before_fork() -> None:
    if "polars" in sys.modules:  # whoever loaded it
        from sysid.base import tables

        tables.note_fork()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork)
