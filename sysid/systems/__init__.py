"""Plants with known truth: one file, one function, one line in `TABLE`."""

from collections.abc import Callable

from sysid.base.checks import checked
from sysid.base.errors import unknown
from sysid.model.system import System
from sysid.systems.paper_shank import paper_shank
from sysid.systems.paper_shoulder import paper_shoulder
from sysid.systems.paper_thigh import paper_thigh
from sysid.systems.textbook import textbook

TABLE: dict[str, Callable[[], System]] = {
    "paper_shank": paper_shank,
    "paper_shoulder": paper_shoulder,
    "paper_thigh": paper_thigh,
    "textbook": textbook,
}


@checked
def system(name: str) -> System:
    """The plant called `name`; raises InputError for a name that is not in `TABLE`."""
    if name not in TABLE:
        raise unknown("system", name, TABLE)
    return TABLE[name]()


__all__ = ["TABLE", "paper_shank", "paper_shoulder", "paper_thigh", "system", "textbook"]
