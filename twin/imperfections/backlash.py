"""Backlash."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection


class Backlash(Imperfection):
    """Without backlash `twin.plant.leg` welds the link to the drive side."""

    name, group = "backlash", "mechanics"
    title = "Backlash"
    about = "Pins and gear teeth have clearance: after each reversal the drive crosses it before the link follows."
    model = (
        "a second hinge in series, free within the backlash and with stiff stops at its ends. The potentiometer sits "
        'behind it (`pot_side="link"`) or before it (`"drive"`). Without gravity\'s help bearing friction holds the '
        "link within the play."
    )
    parameters = "`JOINT.backlash`."
    ideal: ClassVar = {"JOINT.backlash": 0.0}
