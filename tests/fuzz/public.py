"""The public calls of `sysid` and `twin`, each with a valid call and every odd one."""

import importlib
import inspect
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from fuzz.odd_values import odd
from fuzz.supply import Supply

# Rooms and modules whose names users call; of the packages themselves, what their stubs list.
PLACES = (
    "sysid",
    "twin",
    "sysid.blocks",
    "sysid.data",
    "sysid.data.preprocess",
    "sysid.diagnosis.bla",
    "sysid.excitations",
    "sysid.export.c",
    "sysid.export.closed_form",
    "sysid.export.fmu",
    "sysid.export.matlab",
    "sysid.export.mjcf",
    "sysid.export.python",
    "sysid.formats",
    "sysid.joint.design",
    "sysid.linear",
    "sysid.plots",
    "sysid.selection.space",
    "sysid.solver.searches",
    "sysid.structures",
    "sysid.systems",
    "sysid.uncertainty.bands",
    "sysid.uncertainty.curves",
    "sysid.uncertainty.intervals",
    "sysid.uncertainty.responses",
    "twin.compare",
    "twin.design",
    "twin.parameter_file",
    "twin.pendulum",
    "twin.plant.leg",
    "twin.robot.crawl",
    "twin.robot.gait",
    "twin.signatures",
)
# What a call returns, and what only other calls of the library make: nobody calls these with values of their own.
_RESULTS = """
    Advice Fit NlarxFit Signals Comparison Run Format Excitation Recipe InputError Design Phase Continuous Gain Mode
    Noise OperatingPoint OutputBand Curve Interval Band Root FrequencyResponse Travel Standing Measures Trial Crawl
    Plan Axis Line Mark Signature Size Bla Parametric Fragment Trend Source Value Unit
    start fault margins measure check_suffix check_together
"""
RESULTS = frozenset(_RESULTS.split())
# Calls of every step of a search, where parameters or inputs that are not finite give an output that is not.
SEARCHED = ("sysid.Chain.",)


def targets() -> Iterator[tuple[str, Callable[..., Any], str]]:
    """Name, function and class (of a method, else '') of what is called."""
    seen: set[int] = set()
    for place in PLACES:
        module = importlib.import_module(place)
        listed = getattr(module, "__all__", None) or [n for n in vars(module) if not n.startswith("_")]
        for name in listed:
            value = getattr(module, name)
            own = str(getattr(value, "__module__", "")).split(".")[0] in ("sysid", "twin")
            if not own or inspect.ismodule(value) or not callable(value) or id(value) in seen:
                continue
            if not hasattr(module, "__all__") and value.__module__ != place:
                continue
            seen.add(id(value))
            if name not in RESULTS:
                yield f"{place}.{name}", value, ""
            if inspect.isclass(value):
                for method, found in vars(value).items():
                    if not method.startswith("_") and inspect.isfunction(found):
                        yield f"{place}.{name}.{method}", found, name
                    if not method.startswith("_") and isinstance(found, classmethod) and name not in RESULTS:
                        yield f"{place}.{name}.{method}", getattr(value, method), ""


def calls(supply: Supply) -> Iterator[tuple[str, Callable[[], Any], list[tuple[str, str, Callable[[], Any]]]]]:
    """Each target with its valid call and its odd ones: parameter, name of the value, call."""
    for name, function, owner in targets():
        function = supply.named.get(name, function)
        try:
            parameters = list(inspect.signature(function).parameters.values())
        except (TypeError, ValueError):
            continue
        first = ()
        if owner:
            if owner not in supply.instances:
                continue
            first, parameters = (supply.instances[owner],), parameters[1:]
        plain = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
        quick = supply.quick.get(name, {})
        try:
            valid = {p.name: supply.argument(name, p) for p in plain if p.default is p.empty} | quick
        except KeyError:
            yield name, _unknown, []
            continue
        more = [p.name for p in plain]
        if any(p.kind is p.VAR_KEYWORD for p in parameters):
            more += [n for n in quick if n not in more]
        tried = [(p, value, partial(_call, function, first, valid, p, value)) for p in more for value in odd()]
        yield name, partial(function, *first, **valid), tried


def _call(function: Callable[..., Any], first: tuple, valid: dict[str, Any], name: str, value: str) -> Any:
    return function(*first, **{**valid, name: odd()[value]})


def _unknown() -> None:
    raise LookupError("no valid arguments known")
