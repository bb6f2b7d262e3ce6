"""Starting points of a search: one file and one line in `TABLE` per kind of chain; the first that applies is used."""

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.starts._start import Start, clip_to_bounds
from sysid.estimation.starts.box_jenkins import BoxJenkinsStarts
from sysid.estimation.starts.drives import Drives
from sysid.estimation.starts.innovations import Predictors
from sysid.estimation.starts.joint import Joint
from sysid.estimation.starts.own_blocks import OwnBlocks
from sysid.estimation.starts.processes import Processes
from sysid.estimation.starts.profile import Profile
from sysid.estimation.starts.servo import Servo
from sysid.estimation.starts.single_linear import SingleLinear
from sysid.estimation.starts.staged_joint import StagedJoint
from sysid.estimation.starts.state_space import StateSpaces
from sysid.estimation.starts.two_filters import TwoFilters
from sysid.model.chain import Chain

TABLE: dict[str, Start] = {
    "own_blocks": OwnBlocks(),
    "predictors": Predictors(),
    "box_jenkins": BoxJenkinsStarts(),
    "drives": Drives(),
    "servo": Servo(),
    "staged_joint": StagedJoint(),
    "joint": Joint(),
    "processes": Processes(),
    "profile": Profile(),
    "state_space": StateSpaces(),
    "single_linear": SingleLinear(),
    "two_filters": TwoFilters(),
}


def starts(chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
    """Up to `count` starting points theta (P,) within the chain's bounds and fixed values; the best guess is first.

    The longest experiment gives the start. Raises InputError if no entry of `TABLE` applies to the chain.
    """
    for start in TABLE.values():
        if start.applies(chain):
            return [clip_to_bounds(chain, theta) for theta in start.starts(chain, data, count, seed)]
    raise InputError("this chain has no automatic start; give fit() a start of one value for each parameter")
