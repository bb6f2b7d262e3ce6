"""Sampling jitter."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import GUESS, Imperfection, Row


class Jitter(Imperfection):
    """Its rows at 0 are a leg without it."""

    name, group = "jitter", "sensor"
    title = "Sampling jitter"
    about = "The logger's clock is a program that has other things to do."
    model = (
        "a sample is taken off its time by a Gaussian number, at most half a sampling interval; the log has the time "
        "that was meant."
    )
    parameters = "`sample_jitter`."
    rows = (
        Row("sample_jitter", 0.001, 0, 0.05, "s", GUESS, "pot: standard deviation of a sample's time", compiled=False),
    )
    ideal: ClassVar[Mapping[str, float]] = {"sample_jitter": 0.0}
