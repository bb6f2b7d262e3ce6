"""Sampling jitter."""

from typing import ClassVar

from twin.imperfections._declaration import GUESS, Imperfection, Row


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
    rows = (
        Row("sample_jitter", 0.001, 0, 0.05, "s", GUESS, "pot: standard deviation of a sample's time", compiled=False),
    )
    ideal: ClassVar = {"sample_jitter": 0.0}
