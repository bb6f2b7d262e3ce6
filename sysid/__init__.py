"""Identification of block-oriented nonlinear systems: Hammerstein-Wiener and its relatives, checked against truth.

Names load on first use, so that `import sysid` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sysid import (
        closed_form,
        excitations,
        export_c,
        export_python,
        linearize,
        poles,
        preprocess,
        searches,
        structures,
        systems,
    )
    from sysid.chain import Chain
    from sysid.data import IOData
    from sysid.errors import InputError
    from sysid.estimation import fit
    from sysid.fitting import Fit
    from sysid.iterate import Options
    from sysid.objective import Objective
    from sysid.residuals import residual_tests
    from sysid.storage import load, save

_NAMES = {
    "Chain": "sysid.chain",
    "Fit": "sysid.fitting",
    "IOData": "sysid.data",
    "InputError": "sysid.errors",
    "Objective": "sysid.objective",
    "Options": "sysid.iterate",
    "fit": "sysid.estimation",
    "load": "sysid.storage",
    "residual_tests": "sysid.residuals",
    "save": "sysid.storage",
}
_MODULES = (
    "closed_form",
    "excitations",
    "export_c",
    "export_python",
    "linearize",
    "poles",
    "preprocess",
    "searches",
    "structures",
    "systems",
)

__all__ = [
    "Chain",
    "Fit",
    "IOData",
    "InputError",
    "Objective",
    "Options",
    "closed_form",
    "excitations",
    "export_c",
    "export_python",
    "fit",
    "linearize",
    "load",
    "poles",
    "preprocess",
    "residual_tests",
    "save",
    "searches",
    "structures",
    "systems",
]


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        value = getattr(import_module(_NAMES[name]), name)
    elif name in _MODULES:
        value = import_module(f"sysid.{name}")
    else:
        raise AttributeError(f"module 'sysid' has no attribute {name!r}")
    globals()[name] = value
    return value
