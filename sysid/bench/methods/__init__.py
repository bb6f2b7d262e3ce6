"""Methods of the benchmark: one file each, and one line in `TABLE`; several of one kind may share a file."""

from sysid.bench.method import Method
from sysid.bench.methods.from_truth import METHOD as FROM_TRUTH
from sysid.bench.methods.ours import METHODS
from sysid.bench.methods.physical import METHODS as PHYSICAL
from sysid.bench.peers import TABLE as PEERS

GENERAL = tuple(method.name for method in METHODS)  # of this library, for any record
OURS = (*GENERAL, *(method.name for method in PHYSICAL))  # with those that are made for one record
TABLE: dict[str, Method] = {**{method.name: method for method in (FROM_TRUTH, *METHODS, *PHYSICAL)}, **PEERS}
