"""What a unit is: how files write it, and what its numbers become: SI, with the radian as a dimension of its own.

Conversion is by pint with a registry of the units of rigs alone. pint's own has thousands, in which a column `u` is an
atomic mass unit, `t` a metric ton and a radian the number one. Words for units of time stand in the names of columns,
in the languages that logs are written in.
"""

import re
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

from sysid.base.errors import InputError, printable
from sysid.base.quantities import SHARE, Unit, display_quantity

_SINGULAR = {  # these also count something else (`time_of_day`, a second run): a unit only as a whole name
    "s": "s second sekunde seconde segundo secondo",
    "min": "min minute minuto",
    "h": "h hour hr std stunde heure hora ora ore",
    "day": "d day tag jour dia día giorno giorni",
    "ms": "millisecond millisekunde milliseconde milisegundo millisecondo",
    "us": "microsecond mikrosekunde microseconde microsegundo microsecondo",
    "ns": "nanosecond nanosekunde nanoseconde nanosegundo nanosecondo",
}
_PLURAL = {
    "s": "sec secs seconds sekunden sek secondes segundos secondi",
    "min": "mins minutes minuten minutos minuti",
    "h": "hours hrs stunden heures horas",
    "day": "days tage jours dias días",
    "ms": "ms msec msecs millis millisec millisecs milliseconds millisekunden millisecondes milisegundos millisecondi",
    "us": "us µs μs usec usecs micros microsec microsecs microseconds mikrosekunden microsecondes microsegundos "
    "microsecondi",
    "ns": "ns nsec nsecs nanos nanosec nanosecs nanoseconds nanosekunden nanosecondes nanosegundos nanosecondi",
}
ANYWHERE = {word: unit for unit, words in _PLURAL.items() for word in words.split()}
ALONE = {word: unit for unit, words in _SINGULAR.items() for word in words.split()}
TIMES = ANYWHERE | ALONE
UNSURE = ("d", "h")  # a height, a host's or a device's clock as often as days and hours
_TIME = "t|time|timestamp|stamp|clock|elapsed|uptime|duration|zeit|laufzeit|temps|tiempo|tempo"
_NAMED = re.compile(rf"(?:(?:{_TIME})(?:[\W_]*|[\W_]+in[\W_]+))?(?P<unit>{'|'.join(sorted(TIMES, key=len)[::-1])})")
# hhmmss: a time of day written as one number.
DIGITS = re.compile(r"(?:[yj]{2,4}m{2}[dt]{2})?(?:h{2}m{2}(?:s{1,2})?|hms)")


SI = ("s", "V", "rad", "rad/s", "A", "m", "m/s", "N", "N*m", "1", SHARE)  # read as they are, without loading pint
KEPT = ("degC", "°C", "K", "bar", "mbar", "l/min", "L/min")  # known of processes, and read as they are
COUNTS = "counts"  # of a converter or an encoder: numbers without a unit until a calibration gives them one
DEFINITIONS = """
nano- = 1e-9 = n-
micro- = 1e-6 = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
second = [time] = s = sec
minute = 60 * second = min
hour = 3600 * second = hr = h
day = 86400 * second
hertz = 1 / second = Hz
radian = [angle] = rad
degree = 0.017453292519943295 * radian = deg
revolution = 6.283185307179586 * radian = rev = turn
rpm = revolution / minute
arcminute = degree / 60 = arcmin
volt = [voltage] = V
ampere = [current] = A = amp
metre = [length] = m = meter
newton = [force] = N
kilogram = [mass] = kg
gram = 1e-3 * kilogram = g
""".strip()
_SPELLINGS = {  # that are no units of the registry; looked up in small letters where the text itself is none
    "V": "volt volts v",
    "mV": "millivolt millivolts",
    "A": "amps",
    "rad": "radians radian rad",
    "deg": "degrees degree deg",
    "rpm": "rpm rev/min",
    "rev/s": "rps",
    "rev": "revs",
    "N*m": "nm",
    "percent": "% pct percent",
    COUNTS: "count counts cts lsb ticks tick",
    "1": "-",
}
SPELLINGS = {word: unit for unit, words in _SPELLINGS.items() for word in words.split()}
SPELLINGS |= {word: unit for word, unit in TIMES.items() if word not in UNSURE}
_SIGNS = str.maketrans({"µ": "u", "μ": "u", "·": "*", "×": "*", "°": "deg", "º": "deg", "²": "^2", "⁻": "-", "¹": "1"})
_DEGREES = re.compile(r"\b(?:Grad|[Gg]rados?|[Dd]egrés?)\b")  # a grad in small letters may be a gon
_TERM = r"(?:[A-Za-z]+(?:\^?-?[1-9])?|1)"
_UNIT = re.compile(rf"{_TERM}(?:\s*[*/.]\s*{_TERM}|\s+{_TERM}){{0,3}}")  # nothing that could compute for long


@dataclass(frozen=True)
class Conversion:
    """Numbers in a unit times `factor` are numbers in `unit`; `known` is False for a unit that stays as it is."""

    unit: str
    factor: float
    known: bool = True

    @property
    def is_time(self) -> bool:
        """Whether the numbers become seconds."""
        return self.unit == "s"


def convert(text: str) -> Conversion:
    """What a unit as a file writes it becomes: degrees rad, mV V, rpm rad/s, ms s, percent shares of 1.

    Counts, no unit and unknown units stay as they are.
    """
    return _convert(" ".join(text.split()))


def unit_of_file(text: str) -> str:
    """The stored unit of numbers that a file has in the unit `text`, which people go on reading in that one.

    Angles are read in degrees, as the values of a joint are, whatever the file has.
    """
    conversion = convert(text)
    stored, scale = conversion.unit, conversion.factor
    is_same = abs(display_quantity("", stored).factor * scale - 1.0) < 1e-9
    return (
        printable(stored)
        if is_same or not conversion.known or stored in ("rad", "1")
        else Unit(stored, text, 1.0 / scale)
    )


def seconds(text: str) -> float:
    """Seconds in one unit of time. Raises InputError for another unit."""
    conversion = convert(text)
    if not (conversion.known and conversion.is_time):
        raise InputError(f"{text!r} is no unit of time; give s, ms, us, ns, min, h or day")
    return conversion.factor


def is_time(text: str) -> bool:
    """Whether a text is a unit of time."""
    return convert(text).is_time


def time_word(name: str) -> str:
    """The word that a name is but for a word for time before it: `Stunden`, `t_min`, `tms`; nothing for others."""
    match = _NAMED.fullmatch(name.strip().lower())
    return match["unit"] if match else ""


@lru_cache(1024)  # units come from files: a long session may meet any number of them
def _convert(text: str) -> Conversion:
    """The conversion of a text without blanks around it."""
    if text in (*SI, *KEPT, COUNTS):
        return Conversion(text, 1.0)
    if text == "":
        return Conversion("", 1.0, False)
    plain = _DEGREES.sub("deg", text).translate(_SIGNS)
    conversion = _by_pint(plain)
    if conversion is None:
        word = SPELLINGS.get(text.lower(), SPELLINGS.get(plain.lower()))
        if word == "percent":
            return Conversion(SHARE, 0.01)
        conversion = Conversion(word, 1.0) if word in (*SI, COUNTS) else _by_pint(word) if word else None
    return conversion or Conversion(text, 1.0, False)


def _by_pint(text: str) -> Conversion | None:
    if not _UNIT.fullmatch(text):
        return None
    expression = re.sub(r"([A-Za-z])(-?[1-9])", r"\1^\2", text).replace(".", "*")
    try:
        value = _registry().Quantity(1.0, expression.replace("^", "**")).to_root_units()
    except Exception:  # pint has an error of its own for each way of being no unit: each means that it is unknown
        return None
    unit = f"{value.units:~}".replace(" ", "").replace("**", "^").replace("m*N", "N*m")
    return Conversion(unit or "1", float(value.magnitude))


@cache
def _registry() -> Any:
    """Built on first use: pint takes a quarter of a second to load."""
    import pint

    return pint.UnitRegistry(DEFINITIONS.splitlines(), on_redefinition="raise")
