"""Identification of block-oriented nonlinear systems: Hammerstein-Wiener and its relatives, checked against truth.

Names load on first use, so that `import sysid` stays light; `__init__.pyi` lists them. Every room is an attribute,
listed or not.
"""

import os
import sys
from typing import Any

import lazy_loader as lazy

_listed, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
_MOVED = {
    "Advice": "diagnosis.advice",
    "Signals": "channels.signals",
    "higher_order_tests": "diagnosis.residuals",
}


def __getattr__(name: str) -> Any:
    if name in __all__:
        return _listed(name)
    if name in _MOVED:
        raise AttributeError(f"sysid.{name} is sysid.{_MOVED[name]}.{name} now")
    from sysid.base import modules_of

    return modules_of(__name__)[0](name)


def _before_fork() -> None:
    if "polars" in sys.modules:  # whoever loaded it
        from sysid.base import tables

        tables.note_fork()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork)
