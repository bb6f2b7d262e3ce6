"""Methods of the benchmark: one file each, and one line in `TABLE`; several of one kind may share a file."""

from sysid.bench.method import Method
from sysid.bench.methods.from_truth import METHOD as FROM_TRUTH
from sysid.bench.methods.ours import METHODS as OURS
from sysid.bench.methods.physical import METHODS as PHYSICAL

TABLE: dict[str, Method] = {method.name: method for method in (FROM_TRUTH, *OURS, *PHYSICAL)}
