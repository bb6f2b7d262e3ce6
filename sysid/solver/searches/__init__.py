"""Search methods: one line in `TABLE` each, those of a kind in one file. The loop around: `sysid.solver.iterate`."""

from sysid.base.checks import checked
from sysid.base.errors import unknown
from sysid.solver.iterate import Search
from sysid.solver.searches.auto import Auto
from sysid.solver.searches.gauss_newton import AdaptiveGaussNewton, GaussNewton, LevenbergMarquardt
from sysid.solver.searches.gradient import Gradient
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
