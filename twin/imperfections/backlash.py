"""Backlash."""

from collections.abc import Mapping
from typing import ClassVar

from twin.declared import Imperfection


class Backlash(Imperfection):
    """Without play `twin.plant.leg` welds the link to the drive side."""

    name, group = "backlash", "mechanics"
    title = "Backlash"
    about = "Pins in their holes and teeth in their gaps have play: at each reversal the drive runs some way alone."
    model = (
        "a second hinge in series, free within the play and stopped stiffly at its ends. The potentiometer sits "
        'behind it (`pot_side="link"`) or before it (`"drive"`). Without gravity\'s help bearing friction holds the '
        "link within the play."
    )
    parameters = "`JOINT.backlash`."
    ideal: ClassVar[Mapping[str, float]] = {"JOINT.backlash": 0.0}
