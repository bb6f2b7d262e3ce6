"""Progress of a fit: every search is told, and the bar only moves forward and never to the end."""

import numpy as np

from sysid.data.record import IOData
from sysid.structures import ActuatedJoint
from sysid.workflow.evaluation import Setting
from sysid.workflow.identification import identify_file
from twin.cli.console import Searches, Steps


def test_a_joint_tells_each_search_of_its_fit(tmp_path):
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-10.0, 10.0, 15), 20)
    data = IOData(u, np.cumsum(u) + rng.normal(size=300), 0.05)
    file = tmp_path / "log.csv"
    np.savetxt(file, np.column_stack([data.u, data.y]), delimiter=",", header="voltage [V],angle [rad]", comments="")
    seen: list[tuple[float, str]] = []
    steps = Steps(lambda done, name: seen.append((done, name)))
    steps("fitting")
    setting = Setting(ActuatedJoint(load="none", stops="none"), starts=1)
    identify_file(file, setting, Ts=0.05, progress=Searches(steps))
    done, names = zip(*seen[1:], strict=True)
    assert len(done) > 10
    assert 0.0 < done[0] <= done[-1] < 1.0
    assert list(done) == sorted(set(done))
    assert names[0].startswith("search 1, actuated joint: loss")
