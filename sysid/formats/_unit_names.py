"""Units in the names of columns: `t [ms]`, `angle (deg)`, `pos/deg`, `u_V`; only where the text is one beyond doubt.

A bracket holds a unit if its text is spelled as one: `q[1]` and `angle (raw)` have none. Behind an underscore or a
blank most letters mean something else as often as a unit: `y_m` is a measured y, `phase_A` a phase, `u_in` an input,
`t_min` the least t. So one letter there is a unit only behind a name of its quantity (`time_s`, `i_A`, `height_m`),
volts alone behind any name; `_in`, `_g`, `_d` never are, `_min` and `_h` behind a word for time alone. Of columns that
differ in such a letter alone none has a unit if one of the letters is none: `u_U`, `u_V`, `u_W`.
"""

import re
from collections.abc import Iterable

from sysid.base.checks import checked

PREFIXED = "s|V|A|m|g|N|Nm|Pa|J|W|Wh|F|H|Hz|T|C|K|Ω|Ohm|ohm|rad|bar|sec|Ah"
PLAIN = (
    "min|h|hr|hrs|deg|mdeg|°|º|rpm|RPM|rps|rev|revs|turns?|°C|º ?C|degC|°F|degF|degrees?C|%|percent|pct|counts?|cts|"
    "ticks?|steps?|LSB|lsb|digits?|pulses?|samples?|bits?|in|inch|inches|ft|feet|lb|lbs|lbf|ozf?|psi|dB|ppm|ppr|cpr|kgf|gon|"
    "[lL]/min|Grad|[Gg]rados?|[Dd]egrés?|G|dps|px|V_?rms|Vpp|mmHg|rad"
)
WORDS = (
    "(?:nano|micro|milli|centi|kilo|mega)?(?:seconds?|volts?|amps?|amperes?|met(?:er|re)s?|grams?|newtons?|pascals?|"
    "watts?|joules?|hertz|hz|radians?|tesla|ohms?|kelvin|celsius|coulombs?|farads?)|secs?|[mu]secs?|minutes?|hours?|"
    "degrees?|revolutions?|newton[- ]?met(?:er|re)s?"
)
FACTOR = rf"(?:(?:[pnuµμmckMG]?(?:{PREFIXED})|{PLAIN}|(?i:{WORDS}))(?:\^?-?\d|[²³]|⁻[¹²])?)"
UNIT = re.compile(rf"(?:1/)?{FACTOR}(?:(?:/| ?[*·⋅.] ?|-| per | ){FACTOR}|/\({FACTOR}(?:[*·⋅ ]{FACTOR})+\))*")

_SHORT = (  # spelled with more than one letter, and hardly anything else behind an underscore
    "ms us µs μs ns sec secs msec usec seconds milliseconds microseconds mV uV kV volt volts mA uA amp amps mW kW "
    "mm cm um µm km deg Grad rad mrad degrees radians dps rpm rps Hz kHz MHz Nm mNm mN kN Pa kPa hPa MPa bar mbar "
    "psi degC degF percent pct counts ticks ohm Ohm kOhm kg"
)
SHORT = tuple(_SHORT.split())
JOINED = {"radps": "rad/s", "degps": "deg/s", "mps": "m/s", "mmps": "mm/s", "mps2": "m/s^2", "radps2": "rad/s^2"}
RATE = re.compile(r"(.*?[^\W_].*?)[_ ](deg|rad|m|mm|cm|km|rev)_(?:per_)?(s|s2|min|h)")
LETTER = {  # a letter and the names behind which it is a unit
    "s": r"t|time|zeit|laufzeit|tiempo|times|timestamp|stamp|clock|elapsed|duration|delay|dt|ts|seconds?|uptime|t\d+",
    "A": r"i|current|curr?|amps?|iq|id|ia|ib|ic|i_?(?:motor|bus|bat)|amperage",
    "m": r"pos|position|height|length|stroke|distance|dist|travel|extension|displacement|depth|elevation|altitude",
    "N": r"f|force|thrust|tension|load|fx|fy|fz|weight",
    "C": r"t|temp|temps|temperature|tmp",
    "K": r"t|temp|temps|temperature|tmp",
    "W": r"p|power",
    "V": r".+",
}
OF_TIME = re.compile(
    r"(?:.*[_ ])?(?:time|times|timestamp|elapsed|duration|uptime|clock|zeit|laufzeit|tiempo)", re.IGNORECASE
)
LONG_TIMES = ("min", "mins", "minutes", "h", "hr", "hrs", "hours")
FORMS = (
    re.compile(r"(?P<stem>.+?)(?P<mark>\s*)\[\s*(?P<unit>[^][]+?)\s*\]"),
    re.compile(r"(?P<stem>.+?)(?P<mark>\s*)\(\s*(?P<unit>[^()]*(?:\([^()]*\))?[^()]*?)\s*\)"),
    re.compile(r"(?P<stem>.+?)(?P<mark>\s*)\{\s*(?P<unit>[^{}]+?)\s*\}"),
)
LOUD = ("deg", "rad", "rpm")  # as a unit within brackets, in letters of any size
IN = re.compile(r"(?P<stem>.+?)\s+in\s+(?P<unit>\S.*)")
SLASH = re.compile(r"(?P<stem>[^/]*[^/\s\d])\s*/\s*(?P<unit>[^/\s].*)")
FAMILY = re.compile(r"(.+?)([_ ]|\s*[/([{])\s*([A-Za-z])\s*[])}]?")
TIMES = re.compile(r"[_ ](?:x?10+x?|times_?10+|deci|centi|tenths?|hundredths?)$", re.IGNORECASE)  # angle_x10_deg
LONGEST = 300  # letters of a name in which a unit is looked for; the time that this takes grows with their square
TAIL = re.compile(r"(?P<stem>.+)(?P<mark>[_ ])(?P<unit>[^\W\d_]+\d?|%)")


def is_unit(text: str) -> bool:
    """Whether a text is spelled as a unit."""
    return UNIT.fullmatch(text.strip()) is not None


def units_of(names: Iterable[str]) -> dict[str, str]:
    """The unit in each name that has one, as it is written there; `speed_rad_s` gives rad/s."""
    names = [name for name in names if len(name) <= LONGEST]
    units = {name: unit for name in names if (unit := _unit(name))}
    families: dict[str, dict[str, str]] = {}
    for name in names:
        if match := FAMILY.fullmatch(name):
            families.setdefault(match[1] + match[2], {})[match[3]] = name
    for members in families.values():
        if not set(members) <= set(LETTER):  # one is no unit, so the letters count phases or axes
            for letter, name in members.items():
                if letter != "h" or not _names(FAMILY.fullmatch(name)[1], "s"):  # type: ignore[index]
                    units.pop(name, None)
    return units


@checked
def unit_in(name: str) -> str:
    """The unit in one name, as it is written there; nothing if there is none."""
    return units_of([name]).get(name, "")


def _unit(name: str) -> str | None:
    """The unit in one name, None if there is none, whatever other names are beside it."""
    for form in FORMS:
        if match := form.fullmatch(name.strip()):
            stem, unit = match["stem"], match["unit"]
            plural = unit == "s" and not match["mark"] and not _names(stem, "s")  # motor(s)
            is_spelled = is_unit(unit) or unit.lower() in LOUD
            return unit if is_spelled and not plural else None
    if (match := IN.fullmatch(name.strip())) and is_unit(match["unit"]):
        return match["unit"].strip()
    if match := RATE.fullmatch(name):
        return f"{match[2]}/{match[3].replace('s2', 's^2')}"
    if match := SLASH.fullmatch(name):
        unit = match["unit"]
        is_known = is_unit(unit) and not is_unit(name)  # U/min and km/h are no names
        is_known = is_known and (unit not in ("min", "h") or _names(match["stem"], "s"))
        return unit if is_known else None
    if match := TAIL.fullmatch(name):
        stem, unit = match["stem"], match["unit"]
        if TIMES.search(stem):
            return None
        if unit in SHORT or unit == "%" or (unit in LONG_TIMES and OF_TIME.fullmatch(stem)):
            return unit
        if unit in JOINED:
            return JOINED[unit]
        if name.isupper() and len(unit) > 1:
            return next((short for short in SHORT if short.upper() == unit), None)
        return unit if unit in LETTER and _names(stem, unit) else None
    return None


def _names(stem: str, letter: str) -> bool:
    """Whether the last word of a name is a quantity of this unit."""
    words = LETTER[letter]
    last = re.split(r"[_\W]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", stem.strip()))[-1]
    return any(re.fullmatch(words, text, re.IGNORECASE) for text in (stem.strip(), last))
