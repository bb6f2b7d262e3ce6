"""What tests of the command line share."""

import pytest


@pytest.fixture(autouse=True)
def no_progress_of_slow_machines(monkeypatch):
    """A run of more than ten seconds tells its progress in lines on standard error, where tests count sentences."""
    monkeypatch.setattr("twin.cli.console._SLOW", (1e9, 1e9))
