"""Foot on the floor."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection


class Contact(Imperfection):
    """The plant switches all MuJoCo contacts off; no parameter value does that."""

    name, group = "contact", "mechanics"
    title = "Foot on the floor"
    about = ""
    model = (
        "MuJoCo's contact between the foot's sphere and the floor's plane, with a sliding friction of 0.9. The "
        "switch removes all contacts, also those of the torso with the floor. On the bench at nominal height the "
        "foot hangs free."
    )
    parameters = "`bench_height`."
    ideal: ClassVar = {}
