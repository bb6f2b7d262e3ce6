"""Warming: the resistance of the winding rises with the heat that the current leaves in it.

R = R0 (1 + heat), warm_time heat' + heat = warmth i^2, i = (w - v / gain) / (1 + heat) in volts of the cold winding.
Copper gains 0.39 % a kelvin (IEC 60034-1), so a winding that is 60 K warmer has 1.24 times its resistance.
"""

from math import exp

from sysid.block.block import Slot
from sysid.motor_parts._part import Known, MotorPart


def warming_drive(s, w, h, p):
    emf = s.speed / p.gain
    current = (w - emf) / (1.0 + s.heat)
    s.heat += (p.warmth * current * current - s.heat) * (1.0 - exp(-h / p.warm_time))
    return emf + (w - emf) / (1.0 + s.heat)


WARMING = MotorPart(
    "warming",
    "a winding that warms",
    slots=(Slot("warmth", "1/V^2", lower=0.0), Slot("warm_time", "samples", lower=1.0)),
    absent={"warmth": 0.0, "warm_time": 1.0},
    # A stalled motor warms by some 60 K at full voltage before it is cut off; small windings take a minute or two.
    known={"warmth": Known(0.0, 0.2, "one by voltage squared"), "warm_time": Known(60.0, 60.0, "time")},
    shown="warmth",
    equation="the drive counts from the back-EMF by 1/(1 + heat), heat = {} i^2 after {} samples",
    drive=warming_drive,
    volts={"warmth": -2.0},
)
