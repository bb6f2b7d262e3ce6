"""Search methods: one file, one class, one line in `TABLE`. The loop around them is `sysid.iterate`."""

from sysid.errors import unknown
from sysid.iterate import Search
from sysid.searches.adaptive_gauss_newton import AdaptiveGaussNewton
from sysid.searches.auto import Auto
from sysid.searches.gauss_newton import GaussNewton
from sysid.searches.gradient import Gradient
from sysid.searches.levenberg_marquardt import LevenbergMarquardt
from sysid.searches.trust_region import TrustRegion

TABLE: dict[str, type[Search]] = {
    "auto": Auto,
    "gn": GaussNewton,
    "gna": AdaptiveGaussNewton,
    "gradient": Gradient,
    "lm": LevenbergMarquardt,
    "trust_region": TrustRegion,
}


def search(name: str) -> Search:
    """The search called `name`; raises InputError for a name that is not in `TABLE`."""
    if name not in TABLE:
        raise unknown("search", name, TABLE)
    return TABLE[name]()


__all__ = [
    "TABLE",
    "AdaptiveGaussNewton",
    "Auto",
    "GaussNewton",
    "Gradient",
    "LevenbergMarquardt",
    "TrustRegion",
    "search",
]
