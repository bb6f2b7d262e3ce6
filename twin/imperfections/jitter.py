"""Sampling jitter."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection, board_row


class Jitter(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "jitter", "sensor"
    title = "Sampling jitter"
    about = "The logger is a program, and its sampling times vary."
    model = (
        "the time of each sample has a Gaussian error of at most half a sampling interval; the log has the nominal "
        "time."
    )
    parameters = "`sample_jitter`."
    rows = (board_row("sample_jitter", 0.001, 0, 0.05, "s", "pot: standard deviation of a sample's time"),)
    ideal: ClassVar = {"sample_jitter": 0.0}
