"""Foot on the floor."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import Imperfection


class Contact(Imperfection):
    """The plant switches MuJoCo's contacts off as a whole: no row's value does that."""

    name, group = "contact", "mechanics"
    title = "Foot on the floor"
    about = ""
    model = (
        "MuJoCo's contact between the foot's sphere and the floor's plane, with a sliding friction of 0.9. The switch"
        " takes all contacts, the torso's with the floor too. On the bench at its nominal height the foot hangs free."
    )
    parameters = "`bench_height`."
    ideal: ClassVar[Mapping[str, float]] = {}
