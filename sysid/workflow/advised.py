"""Advice on a record once a model is fitted to it: no advice to fit what was fitted, or less than what fits well."""

from dataclasses import replace

from sysid.diagnosis.finding import Advice
from sysid.diagnosis.residuals import POOR
from sysid.structures import Hammerstein, HammersteinWiener, OutputError, Wiener

_CLASSES = {OutputError.name: 0, Hammerstein.name: 1, Wiener.name: 1, HammersteinWiener.name: 2}
_RICHER = 3  # every other structure


def after(advice: Advice, fitted: str, percent: float) -> Advice:
    """The finding without its action, if that names the fitted structure, or a weaker one than a structure that fits.

    `percent` is the fit in validation. A delay keeps its action, which names other orders of the same structure.
    """
    words = advice.command
    named = words[words.index("--structure") + 1] if "--structure" in words else ""
    if not named or advice.topic == "delay":
        return advice
    weaker = _CLASSES.get(named, _RICHER) < _CLASSES.get(fitted, _RICHER)
    if named != fitted and not (weaker and percent >= POOR):
        return advice
    return replace(advice, action="", call="", command=())
