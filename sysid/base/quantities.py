"""What people read: degrees for radians, and numbers with as many digits as they mean."""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """A name, the unit that is shown, and the factor from the stored unit to it."""

    name: str
    unit: str
    factor: float = 1.0

    @property
    def label(self) -> str:
        """For an axis: name [unit]."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def per(self, other: "Quantity") -> "Quantity":
        """This quantity for each unit of another one, of which both may be shown in units that are not the stored."""
        return Quantity(self.name, _ratio(self.unit, other.unit), self.factor / other.factor)


def _ratio(y: str, u: str) -> str:
    if not (y or u):
        return ""
    return f"{y or '1'}/{f'({u})' if '/' in u else u or 'unit'}"


class Unit(str):
    """A stored unit, SI, that knows the unit of its file: people read `shown`, `factor` times the stored number."""

    shown: str
    factor: float

    def __new__(cls, unit: str, shown: str = "", factor: float = 1.0) -> "Unit":
        """Equal to the stored unit."""
        self = super().__new__(cls, unit)
        self.shown, self.factor = shown or unit, factor
        return self


class Units(str):
    """No unit that all channels of a record have, and that of each."""

    each: tuple[str, ...]

    def __new__(cls, unit: str = "", each: Sequence[str] = ()) -> "Units":
        """Equal to no unit."""
        self = super().__new__(cls, unit)
        self.each = tuple(each)
        return self


def unit_of_channel(unit: str, k: int) -> str:
    """The unit of channel k (from 0) of those whose common one is `unit`."""
    return unit.each[k] if isinstance(unit, Units) else unit


def ratio(y: str, u: str) -> "Unit":
    """The unit of y for each unit of u, such as "degC/%", read in the units of both; empty where neither has one."""
    a, b = display_quantity("", y), display_quantity("", u)
    return Unit(_ratio(y, u), _ratio(a.unit, b.unit), a.factor / b.factor)


def rate(y: str, below: str) -> str:
    """The unit of y for each of `below`, such as "s/V", read in that of y."""
    return Unit(f"{y}/{below}", f"{y.shown}/{below}", y.factor) if isinstance(y, Unit) else f"{y}/{below}"


def of_place(y: str) -> str:
    """The unit of what a speed in y leads to: mm of mm/s, rad of rpm; that of y where it is none of a speed."""
    if not y.endswith("/s"):
        return y
    if isinstance(y, Unit) and y.shown.endswith("/s"):
        return Unit(y.removesuffix("/s"), y.shown.removesuffix("/s"), y.factor)
    return y.removesuffix("/s")


_ROUNDING = 1e-13  # of a number: a width below it is that of the arithmetic
SHARE = "share"  # the unit of a number that its file has in per cent: stored as a part of 1, shown as it was


def display_quantity(name: str, unit: str) -> Quantity:
    """How a quantity is shown: in the unit of its file if that is known (`Unit`), radians as degrees, shares as per
    cent, also per second or per volt; nothing for a plain number.

    A natural frequency stays in rad/s, as options and formulas have it.
    """
    if isinstance(unit, Unit):
        return Quantity(name, unit.shown, unit.factor)
    if name == "natural frequency":
        return Quantity(name, unit)
    first, *below = unit.split("/")
    shown, factor = {"rad": ("deg", 180.0 / math.pi), SHARE: ("%", 100.0)}.get(first, (first, 1.0))
    factor /= 100.0 ** below.count(SHARE)
    text = "/".join([shown, *("%" if part == SHARE else part for part in below)])
    return Quantity(name, "" if text == "1" else text, factor)


def number(value: float | None, digits: int = 4) -> str:
    """`digits` significant digits, a power of ten only where it saves the reader zeros, a dash for nothing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    magnitude = math.floor(math.log10(abs(value)))
    if -4 <= magnitude < 6:
        text = f"{value:.{max(digits - 1 - magnitude, 0)}f}"
    else:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        text = f"{mantissa}e{int(exponent)}"
    return text.replace("-", "−")


def estimate(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A value and the ends of its interval, with the digits that the interval means: two significant ones of its half
    width, as for an uncertainty (JCGM 100:2008, 7.2.6); four of each where the interval has no width or no end.
    """
    ends, numbers = [x for x in (low, high) if math.isfinite(x)], (value, low, high)
    half = 0.5 * (high - low) if len(ends) == 2 else max((abs(x - value) for x in ends), default=0.0)
    largest = max((abs(x) for x in (value, *ends)), default=0.0)
    if not (math.isfinite(value) and half > _ROUNDING * largest):
        first, second, third = (number(x) for x in numbers)
        return first, second, third
    last = math.floor(math.log10(float(f"{half:.1e}"))) - 1  # power of ten of the last digit
    first, second, third = (_to_place(x, last, largest) for x in numbers)
    return first, second, third


def _to_place(value: float, last: int, largest: float) -> str:
    """A number to the power of ten `last`, beside others up to `largest`."""
    if not math.isfinite(value):
        return number(value)
    if 1e-4 <= largest < 1e6:
        return f"{round(value, -last):z.{max(-last, 0)}f}".replace("-", "−")
    value = round(value, -last)
    return number(value, max(math.floor(math.log10(abs(value))) - last + 1, 1)) if value else "0"


def percent(value: float) -> str:
    """A fit with two decimals; below -1000 only that it is below."""
    if not math.isfinite(value) or value < -1000:
        return "< −1000 %"
    return f"{value:.2f} %".replace("-", "−")


def pole(value: complex) -> str:
    """A pole with four decimals: 0.9743, or 0.81 ± 0.20i for the upper one of a pair."""
    real = f"{value.real:.4f}".replace("-", "−")
    if abs(value.imag) < 5e-5:
        return real
    return f"{real} ± {abs(value.imag):.4f}i"


def poles(values) -> str:
    """Poles in the order of falling size, each pair once; equal ones are counted."""
    ordered = sorted((complex(p) for p in values), key=lambda p: (-round(abs(p), 6), p.real))
    count = Counter(pole(p) if p else "0" for p in ordered if p.imag > -5e-5)
    return ", ".join(text if n == 1 else f"{text} ({n} times)" for text, n in count.items()) or "none"


def probability(p: float) -> str:
    """A probability of chance as people tell it: p = 0.012, or p < 0.0001."""
    return f"p = {p:.2g}" if p >= 1e-4 else "p < 0.0001"


def capital(text: str) -> str:
    """The text with a capital letter first, unless it begins with a symbol (e, u1) or the name of a file (a.csv), which
    would become another one.
    """
    return text if re.match(r"([b-z]|[a-z]\d+)\b|\S*\w\.[A-Za-z]\w", text) else text[:1].upper() + text[1:]
