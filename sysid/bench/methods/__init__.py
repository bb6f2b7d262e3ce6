"""Methods of the benchmark: one file each, and one line in `TABLE`; several of one kind may share a file."""

from sysid.bench.method import Method
from sysid.bench.methods.from_truth import METHOD as FROM_TRUTH
from sysid.bench.methods.ours import METHODS
from sysid.bench.peers import TABLE as PEERS

OURS = tuple(method.name for method in METHODS)  # of this library, without the bar
TABLE: dict[str, Method] = {method.name: method for method in (FROM_TRUTH, *METHODS)} | PEERS
