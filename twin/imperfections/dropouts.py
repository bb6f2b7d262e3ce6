"""Lost samples."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import GUESS, Imperfection, Row


class Dropouts(Imperfection):
    """Its rows at 0 are a leg without it."""

    name, group = "dropouts", "sensor"
    title = "Lost samples"
    about = "Now and then the logger misses a sample."
    model = "each sample but the first is missed with the same probability; the log repeats the one before."
    parameters = "`dropout_rate`."
    rows = (
        Row(
            "dropout_rate",
            0.002,
            0,
            0.2,
            "1",
            GUESS,
            "pot: part of the samples that the logger misses; it repeats the last",
            compiled=False,
        ),
    )
    ideal: ClassVar[Mapping[str, float]] = {"dropout_rate": 0.0}
