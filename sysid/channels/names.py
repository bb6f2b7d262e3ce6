"""What the name of a column says: its unit, and whether it is time, input or output."""

import re
from dataclasses import dataclass

from sysid.channels.mapping import Channel
from sysid.channels.units import COUNTS

CLOCK = {"t", "time", "timestamp", "timestamps", "stamp", "clock", "millis", "micros", "elapsed", "ms", "us", "ns"}
CLOCK |= {"seconds", "sec", "secs", "msec", "usec", "zeit"}
COUNTERS = {"index", "idx", "sample", "samples", "k", "n", "i", "row", "seq", "sequence", "frame", "counter", "id"}
INPUT = {
    "u",
    "voltage",
    "volts",
    "volt",
    "pwm",
    "duty",
    "cmd",
    "command",
    "commanded",
    "input",
    "in",
    "control",
    "ctrl",
}
REFERENCE = {"reference", "ref", "goal", "setpoint", "target", "desired", "des", "cmd", "command", "commanded"}
OUTPUT = {"y", "angle", "pos", "position", "adc", "pot", "potentiometer", "theta", "q", "encoder", "enc", "output"}
OUTPUT |= {"out", "winkel"}
# The output of a controller is the input of what it moves: controller_output beside sensor_input.
BEFORE = {"controller", "control", "ctrl", "pid", "mpc", "regler", "actuator", "drive", "driver", "amplifier", "dac"}
BEHIND = {"sensor", "adc", "daq", "measurement", "feedback"}
NEVER = {"true", "error", "err", "std", "sigma", "var", "residual", "enable", "enabled", "flag", "state", "status"}
ASIDE = {"speed", "velocity", "vel", "omega", "rate", "acceleration", "acc", "accel", "temp", "temperature", "load"}
ASIDE |= {"current", "torque", "supply", "vin", "vbat", "battery", "vcc", "vdd", "power", "effort", "gyro"}
# Of a file of two columns these say which is which; among more columns they may mean something else.
INPUT_TOO = {"inputs", "uin", "excitation", "excite", "stimulus", "drive", "actuator", "actuation", "torque", "force"}
INPUT_TOO |= {"current", "load", "power", "effort", "cmds", "commands", "eingang", "spannung", "stellwert", "sollwert"}
OUTPUT_TOO = {"outputs", "yout", "uout", "response", "measured", "measurement", "meas", "sensor", "reading", "speed"}
OUTPUT_TOO |= {"velocity", "vel", "omega", "rate", "acceleration", "acc", "accel", "gyro", "temp", "temperature"}
OUTPUT_TOO |= {"displacement", "ausgang", "messwert", "istwert", "lage", "drehzahl", "angles", "positions"}
IN = re.compile(r"(?<=\S)\s+in\s+(?=\S)")  # before a unit


@dataclass(frozen=True)
class Header:
    """A column's name without its unit, the unit as it is written, and the words of the name in small letters."""

    name: str
    base: str
    unit: str
    words: frozenset[str]

    def has(self, words: set[str]) -> bool:
        """Whether one of the words is in the name."""
        return bool(self.words & words)


def header(name: str, unit: str = "") -> Header:
    """The header of a column; `unit` is what its reader found in or beside the name."""
    base = name.strip()
    if unit:
        for form in (
            r"(.+?)\s*[\[({]\s*[^\[\](){}]*\s*[\])}]",
            rf"(.+?)\s+in\s+{_spelled(unit)}",
            rf"(.+?)\s*[/_, ]\s*{_spelled(unit)}",
        ):
            match = re.fullmatch(form, base)
            if match:
                base = match[1]
                break
    said = IN.sub(" ", base)  # "Weg in Schritten" names no input
    words = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_]+", said)
    return Header(name, base, unit.strip(), frozenset(word.lower() for word in words))


def _spelled(unit: str) -> str:
    """A pattern for the unit as it may stand in a name: rad/s as rad_s."""
    return "[/_]".join(map(re.escape, unit.split("/")))


def is_numbered(name: str) -> bool:
    """Whether a column has no name of its own: 1, 2, or M:1, M:2 of a matrix M."""
    return name.rpartition(":")[2].isdigit()


def label(channel: Channel, role: str, unit: str = "") -> str:
    """The name of a channel in reports: without `unit`, if the column's own name says it."""
    if channel.name:
        return channel.name
    if channel.column.isdigit():
        return role
    return header(channel.column, unit).base.replace("_", " ").strip() or role


def unit_text(found: Header) -> str:
    """The unit for a mapping: as it is written, or counts where only the name says so."""
    if found.unit:
        return found.unit
    return COUNTS if found.has({"adc", "counts", "ticks"}) else ""
