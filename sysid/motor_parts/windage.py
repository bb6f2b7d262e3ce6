"""Windage: a drag that rises with the square of the speed, of a fan, a propeller or oil in a gear."""

from sysid.block.block import Slot
from sysid.motor_parts._part import Known, MotorPart


def windage_drag(s, p):
    return p.windage * s.speed * s.speed


WINDAGE = MotorPart(
    "windage",
    "drag by the square of the speed",
    slots=(Slot("windage", "V samples^2", lower=0.0),),
    absent={"windage": 0.0},
    known={"windage": Known(0.0, 0.5, "friction by speed squared")},  # at full speed half of the dry friction
    shown="windage",
    equation="and {}*v^2 against the motion",
    drag=windage_drag,
    volts={"windage": 1.0},
    places={"windage": -2.0},
)
