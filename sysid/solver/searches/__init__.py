"""Search methods: one file, one class, one line in `TABLE`. The loop around them is `sysid.solver.iterate`."""

from sysid.base.checks import checked
from sysid.base.errors import unknown
from sysid.solver.iterate import Search
from sysid.solver.searches.adaptive_gauss_newton import AdaptiveGaussNewton
from sysid.solver.searches.auto import Auto
from sysid.solver.searches.gauss_newton import GaussNewton
from sysid.solver.searches.gradient import Gradient
from sysid.solver.searches.levenberg_marquardt import LevenbergMarquardt
from sysid.solver.searches.trust_region import TrustRegion

TABLE: dict[str, type[Search]] = {
    "auto": Auto,
    "gn": GaussNewton,
    "gna": AdaptiveGaussNewton,
    "gradient": Gradient,
    "lm": LevenbergMarquardt,
    "trust_region": TrustRegion,
}


@checked
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
