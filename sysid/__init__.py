"""Identification of block-oriented nonlinear systems: Hammerstein-Wiener and its relatives, checked against truth.

Names load on first use, so that `import sysid` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sysid import (
        bands,
        bla,
        closed_form,
        curves,
        excitations,
        export_c,
        export_python,
        intervals,
        linearize,
        plots,
        poles,
        preprocess,
        responses,
        searches,
        structures,
        systems,
    )
    from sysid.advice import Advice, advise
    from sysid.certainty import information
    from sysid.chain import Chain
    from sysid.data import IOData
    from sysid.errors import InputError
    from sysid.estimation import fit
    from sysid.fitting import Fit
    from sysid.higher_order import higher_order_tests
    from sysid.iterate import Options
    from sysid.joint_growth import grow_joint
    from sysid.joint_values import joint_values
    from sysid.nlarx_estimation import fit_nlarx
    from sysid.nlarx_fit import NlarxFit
    from sysid.objective import Objective
    from sysid.residuals import residual_tests
    from sysid.storage import load, save
    from sysid.validation import compare, cross_validate

_NAMES = {
    "Advice": "sysid.advice",
    "Chain": "sysid.chain",
    "Fit": "sysid.fitting",
    "IOData": "sysid.data",
    "InputError": "sysid.errors",
    "NlarxFit": "sysid.nlarx_fit",
    "Objective": "sysid.objective",
    "Options": "sysid.iterate",
    "advise": "sysid.advice",
    "compare": "sysid.validation",
    "cross_validate": "sysid.validation",
    "fit": "sysid.estimation",
    "fit_nlarx": "sysid.nlarx_estimation",
    "grow_joint": "sysid.joint_growth",
    "higher_order_tests": "sysid.higher_order",
    "information": "sysid.certainty",
    "joint_values": "sysid.joint_values",
    "load": "sysid.storage",
    "residual_tests": "sysid.residuals",
    "save": "sysid.storage",
}
_MODULES = (
    "bands",
    "bla",
    "closed_form",
    "curves",
    "excitations",
    "export_c",
    "export_python",
    "intervals",
    "linearize",
    "plots",
    "poles",
    "preprocess",
    "responses",
    "searches",
    "structures",
    "systems",
)

__all__ = [
    "Advice",
    "Chain",
    "Fit",
    "IOData",
    "InputError",
    "NlarxFit",
    "Objective",
    "Options",
    "advise",
    "bands",
    "bla",
    "closed_form",
    "compare",
    "cross_validate",
    "curves",
    "excitations",
    "export_c",
    "export_python",
    "fit",
    "fit_nlarx",
    "grow_joint",
    "higher_order_tests",
    "information",
    "intervals",
    "joint_values",
    "linearize",
    "load",
    "plots",
    "poles",
    "preprocess",
    "residual_tests",
    "responses",
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
