"""Lost samples."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection, board_row


class Dropouts(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "dropouts", "sensor"
    title = "Lost samples"
    about = "The logger sometimes misses a sample."
    model = (
        "each sample except the first is missed with the same probability; the log then repeats the previous sample."
    )
    parameters = "`dropout_rate`."
    rows = (
        board_row(
            "dropout_rate",
            0.002,
            0,
            0.2,
            "1",
            "pot: share of samples that the logger misses; it repeats the previous one",
        ),
    )
    ideal: ClassVar = {"dropout_rate": 0.0}
