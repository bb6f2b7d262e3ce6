"""Modules of a class of their own, sent to other processes by name."""

import copyreg
import importlib
import sys
from collections.abc import Callable
from types import ModuleType

FACADES = ("sysid", "twin")


def facades_by_name() -> None:
    """Lets a facade be pickled as the name that it is imported by, whatever its class.

    lazy_loader from 0.6 on gives it a class of its own, which cloudpickle does not know. A function of a script whose
    globals hold the facade could then not be sent to a worker.
    """
    for module in (sys.modules[name] for name in FACADES if name in sys.modules):
        if type(module) is not ModuleType:
            copyreg.pickle(type(module), _named)


def _named(module: ModuleType) -> tuple[Callable[[str], ModuleType], tuple[str]]:
    return importlib.import_module, (module.__name__,)
