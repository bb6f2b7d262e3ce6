"""What the words of the tables mean, one sentence each: shown where a heading or the name of a row is pointed at."""

import re

from sysid.base.criteria import TABLE as CRITERIA

_INTERVAL = (
    "range that holds the true value in 95 of 100 records of this kind, if the structure of the model is that of the "
    "system"
)
_END = (
    "place of the drive at its end stop, in the unit of the output; a joint with backlash rests half of it inside "
    "where the drive pushes it there, and up to half of it beyond where it coasts on"
)
_EFFECTIVE = (
    "effective number of parameters: with initial states, without those that change nothing in the model's behaviour; "
    "a map that is held smooth counts less than its points, so d may be smaller than the list of parameters is long"
)
TERMS = {
    # fits and criteria
    "fit": "100 % is exact, 0 % is as good as the constant mean of the output, below 0 % is worse than that constant",
    "fit, free run, validation data": "share of the output that the model explains from the input alone, on data that "
    "were not used in the fit",
    "fit, free run, estimation data": "the same on the data of the fit, where a model that is too large looks too good",
    "criterion": "a number that judges the model",
    "d": _EFFECTIVE,
    "effective number of parameters d / samples n": f"{_EFFECTIVE}; a record should have many samples for each",
    "rms": "square root of the mean squared error",
    "ceiling": "the fit of the true parameters on the same noisy data, which no model can exceed by more than chance",
    "closed form": "poles computed by hand from the motor's equations, to check the simulated ones",
    "search": "the method that found the parameters",
    "stable": "whether all poles are inside the unit circle",
    # poles
    "z": "place of the root in the complex plane of the sampled system",
    "|z|": "size of the root; below 1 its motion decays, and the nearer to 1 the slower",
    "pole": "a root of the denominator: a motion of its own, which the system makes without input",
    "zero": "a root of the numerator: a motion of the input that the output does not show",
    "time constant": "time after which a motion has decayed to 37 %",
    "poles": "roots of the denominator in z: the system's own motions",
    "poles in z": "roots of the denominator in z: the system's own motions",
    "poles, twin": "roots of the denominator in z of the simulated joint",
    # intervals
    "95 % interval": _INTERVAL,
    "95 % interval now": f"from the first record: {_INTERVAL}",
    "std": "standard deviation of the estimate over records of this kind, for white residuals and this structure",
    "expected": "interval that the fit predicts for a record of this input",
    "expected deviation": "standard deviation that the logs are expected to leave",
    "plausible change": "how far the parameter may lie from its nominal value before any record",
    "told": "whether the logs determine the parameter to a part of the plausible change",
    "acts like": "parameters that change the logs in the same way",
    "noise": "share of the interval that noise makes; the rest is what the twin lacks",
    "not determined": "the record holds no information on this value",
    # physical values of a joint
    "speed per volt, mid stroke": "how much faster the joint moves for each volt more, at the middle of its travel",
    "speed at full drive": "speed in the middle of the travel at the largest drive",
    "speed per volt": "how much faster the joint moves for each volt more, at the middle of its travel",
    "gain of the loop, kp": "drive for each unit of position error, beyond the dead band where there is one",
    "dead band around the goal": "largest error on which the servo does not act",
    "derivative gain of the loop, kd": "drive for each unit of speed of the position error",
    "break-away voltage up": "smallest voltage that starts a joint at rest towards larger outputs; it includes dry "
    "friction, load and the driver's dead zone",
    "break-away voltage down": "the same towards smaller outputs",
    "voltage for friction and load, moving up": "voltage that friction and load take while the joint moves up",
    "voltage for friction and load, moving down": "voltage that friction and load take while the joint moves down",
    "moving friction up, with load": "voltage that friction and load take while the joint moves up",
    "moving friction down, with load": "voltage that friction and load take while the joint moves down",
    "lower end stop": _END,
    "upper end stop": _END,
    "backlash": "gap between drive and link: the way that the drive moves before the link follows",
    "delay": "time from a change of the input to the first response",
    "time constant + delay": "the two together, which the record determines better than each alone",
    "end stops": "angles of the drive at its two end stops",
    "break-away voltage, down / up": "smallest voltage that starts the joint from rest",
    "break-away voltage": "smallest voltage that starts the joint from rest",
    "dead band of the drive": "voltage below which the driver gives the motor nothing",
    "delay of the command": "time from a command to the motor's voltage",
    "time constant of the lag": "time after which the speed has reached 63 % of its final value",
    "gain": "change of the output, or of its speed, for one unit of the input",
    "backlash, whole width": "gap between drive and link, from one side to the other",
    "degrees per volt of reference": "final angle for one volt of the position loop's reference",
    # tables of records and comparisons
    "unit": "the unit of the numbers in this row",
    "regime": "samples in which the joint does one thing: each sample belongs to the first regime that applies",
    "share of the record": "samples of the regime over all samples",
    "share of the error": "part of the squared error that the regime's samples make",
    "rms of the error": "square root of the mean squared difference between the log and the other side",
    "gear (slope)": "degrees of the log for each degree of the twin; 1 if the sensors agree",
    "offset (angle zero)": "angle of the log where the twin reads zero",
    "delay of the log": "time by which the log is later than the twin under the same input",
    "effect": "one imperfection of the joint",
    "effect, moved alone": "one imperfection whose values alone were fitted to the log",
    "departure that vanishes": "share of the difference beyond noise that is gone once the effect is fitted",
    "rms left": "what remains of the difference with that effect alone",
    "differ": "whether the difference is larger than both intervals explain",
    "rms before": "error with the values from before the calibration",
    "rms after": "error with the calibrated values",
    "fit before": "free-run fit with the values from before the calibration",
    "fit after": "free-run fit with the calibrated values",
    "calibrated": "value with which the simulation follows the logs best",
    "before": "value before the calibration",
    "start": "value at which the search began",
    "truth": "the value that the simulation used",
    "aim ±": "error that counts as found",
    "empty cells": "cells of the file without a value",
    "cells": "number of cells in the column",
    "no number": "cells that hold no number",
    "read as": "input, output or time",
} | {criterion.label.lower(): criterion.meaning for criterion in CRITERIA.values()}


def without_unit(term: str) -> str:
    """A heading or the name of a row without its unit: 'time constant [s]' is 'time constant'."""
    return re.sub(r"\s*\[[^\]]*\]", "", str(term)).strip()


def meaning(term: str) -> str:
    """The sentence for a heading or the name of a row, with or without its unit; empty if it needs none."""
    key = without_unit(term).lower()
    if key.startswith("loss v"):
        return "mean squared error that the search made as small as it could"
    return TERMS.get(key, "")
