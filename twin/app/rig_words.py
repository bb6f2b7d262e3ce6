"""What the page says of a rig: a calibration in words, and sentences of `twin.rig` that name the page's controls."""

import math
import re

from twin.rig.calibration import Calibration

# Sentences of `twin.rig` speak to people at a command line; here the page has a control for it.
WORDS = (
    (r"run qpal rig zero first", "find the ends first"),
    (r"run qpal rig zero again", "find the ends again"),
    (r"make it with qpal rig wire", "check the wiring, which makes it"),
    (r"make (it|the file) anew with qpal rig wire", "check the wiring again, which makes it anew"),
    (r"qpal rig find lists the ports", "choose another port"),
    (r"qpal rig find lists those of this machine", "choose one of the list"),
    (r"perhaps another qpal rig", "perhaps another qpal app, or qpal rig in a terminal"),
    (r"design it with --volts (\S+)", r"choose an input of at most \1 V"),
    (r"give another --channel", "choose another joint number"),
    (r"give --channel (\S+)", r"choose joint number \1"),
)


def words_of_page(sentence: str) -> str:
    """A sentence of `twin.rig` with the page's controls in place of options of a command line."""
    for pattern, words in WORDS:
        sentence = re.sub(pattern, words, sentence)
    if re.search(r"--[a-z]", sentence):  # columns of an input, which the page does not ask for
        return f"{sentence.partition('; ')[0]}; give a file with the columns time [s] and u [V]"
    return sentence


def sentences(calibration: Calibration) -> list[str]:
    """A calibration in words."""
    c = calibration
    lines = [
        f"{c.joint}, joint {c.channel} of the board; supply {c.supply:g} V, inputs up to {c.largest:g} V",
        f"the motor's sign is {'reversed' if c.motor_reversed else 'as the sensor’s'}; the joint moves from "
        f"{c.moves_up:.0%} of the supply on to higher counts, {c.moves_down:.0%} to lower ones",
    ]
    if not c.is_zeroed:
        return [*lines, "its ends have no angles yet"]
    angles = (c.low_angle, c.high_angle, c.soft_low, c.soft_high, c.strike, c.motion)
    low, high, soft_low, soft_high, strike, motion = (math.degrees(angle or 0.0) for angle in angles)
    return [
        *lines,
        f"ends: {c.low_counts:.0f} counts at {low:.1f} deg, {c.high_counts:.0f} counts at {high:.1f} deg",
        f"the motor is cut below {soft_low:.1f} and above {soft_high:.1f} deg; the drive goes off at {strike:.0f} "
        f"deg/s, and after {c.stall:g} s of drive without {motion:.1f} deg of motion",
    ]
