"""The bar: a search of the true structure that begins at the true parameters. It sees what no method may see."""

from sysid.base.errors import InputError
from sysid.bench.contract import Data
from sysid.bench.method import Inside
from sysid.bench.methods.ours import Ours, record
from sysid.bench.task import Task
from sysid.fitting import fit


def from_truth(data: Data, task: Task) -> Ours:
    """The optimum near the truth. Raises InputError for a scenario whose plant is no chain."""
    truth = task.truth
    if truth is None or truth.chain is None:
        raise InputError("the plant of this scenario is no chain, so no search can begin at its parameters")
    own = record(data)
    return Ours(fit(truth.chain, own, start=truth.theta), own, (0.0, 0.0))


METHOD = Inside("from_truth", "the true structure, begun at the truth: the bar", from_truth, sees_truth=True)
