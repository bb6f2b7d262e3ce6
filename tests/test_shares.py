"""Shares of tests, by the scheduler that hands them out."""

from types import SimpleNamespace

import pytest
from shares import in_shares
from xdist.scheduler import WorkStealingScheduling

LONG = ("b1", "b4", "d0", "f2")
ITEMS = [f"{file}{k}" for file in "abcdef" for k in range(5)] + ["g0"]  # one more than shares of equal size have


class Worker:
    """What the scheduler needs of a worker: it keeps what it was sent."""

    shutting_down = False
    gateway = SimpleNamespace(id="worker")

    def __init__(self):
        self.sent = []

    def send_runtest_some(self, indices):
        self.sent += indices


@pytest.mark.parametrize(("workers", "first"), [(2, ["b1", "d0"]), (3, ["b1", "d0", "f2"])])
def test_every_worker_begins_with_long_tests_and_those_of_a_file_stay_together(workers, first):
    order = in_shares(ITEMS, workers, lambda item: item in LONG, lambda item: item[0])
    scheduler = WorkStealingScheduling(SimpleNamespace(getvalue=lambda name: ["popen"] * workers))
    found = [Worker() for _ in range(workers)]
    for worker in found:
        scheduler.add_node(worker)
        scheduler.add_node_collection(worker, order)
    scheduler.schedule()
    shares = [[order[index] for index in worker.sent] for worker in found]
    assert [share[0] for share in shares] == first
    assert shares[0][1] == "b4"
    assert [i for share in shares for i in share if i not in LONG] == [i for i in ITEMS if i not in LONG]
