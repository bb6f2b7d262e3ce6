"""ChannelMap: which columns of a file are time, input and output, in what units, and what is done about gaps."""

from typing import Annotated, Any, Literal, Self, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sysid.base.errors import InputError
from sysid.base.kinds import SIZE
from sysid.base.limits import SECONDS
from sysid.channels.complaints import MappingError, brief_value, choices_text, complaint
from sysid.channels.conversion import seconds

Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-SIZE, le=SIZE)]
SHORTEST = 1e-12  # [s] a sampling time; no converter is as fast
Whole = Annotated[int, Field(strict=True)]
Text = Annotated[str, Field(strict=True)]
Pair = tuple[Number, Number]
Bits = Literal[0, 8, 16, 24, 32]


class _Part(BaseModel):
    """One table of the file; a field's description is its comment there."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    def __init__(self, **values: Any) -> None:
        """Raises InputError with what was found and what is allowed."""
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise MappingError(*complaint(error, type(self))) from None

    @model_validator(mode="before")
    @classmethod
    def _no_truth_for_a_choice(cls, values: Any) -> Any:
        """True equals 1, and Literal takes it for that."""
        for name, value in values.items() if isinstance(values, dict) else ():
            field = cls.model_fields.get(name)
            if isinstance(value, bool) and field is not None and get_origin(field.annotation) is Literal:
                raise MappingError(
                    (name,), f"{name} is {brief_value(value)}; give {choices_text(get_args(field.annotation))}"
                )
        return values


class Clock(_Part):
    """Where the time of a sample comes from: a column of stamps, or Ts alone."""

    column: Text = Field(default="", description='column of the time stamps; "" if there is none, then Ts is needed')
    unit: Text = Field(default="s", description="unit of the stamps: s, ms, us, ns, min, h, day")
    period: Annotated[Number, Field(gt=0)] | None = Field(
        default=None, description="[unit] after which a counter starts again, such as 65536 of 16 bits; left out: never"
    )
    Ts: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=SHORTEST, le=SECONDS)] | None = Field(
        default=None, description="[s] sampling time of the record; left out: that of the stamps"
    )

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        try:
            seconds(self.unit)
        except InputError as error:
            raise MappingError(("unit",), f"unit {error}") from None
        if not self.column and self.period:
            raise InputError(f"period is {self.period:g} and there is no column; name the column of the stamps")
        return self

    @model_validator(mode="before")
    @classmethod
    def _has_old_name(cls, values: Any) -> Any:
        """Maps that were written before have wrap = 0, which says nothing."""
        bits = values.get("wrap") if isinstance(values, dict) else None
        if bits == 0 and not isinstance(bits, bool):
            return {name: value for name, value in values.items() if name != "wrap"}
        if bits is not None:
            now = f"period = {2**bits}" if isinstance(bits, int) and 0 < bits <= 32 else "period, or leave it out"
            raise MappingError(
                ("wrap",), f"wrap is now period, what a counter counts until it starts again; write {now}"
            )
        return values


class Adc(_Part):
    """A straight line through two points, from counts to values."""

    counts: Pair | None = Field(default=None, description="two readings [counts], or give bits")
    bits: Annotated[Whole, Field(ge=1, le=32)] | None = Field(
        default=None, description="bits = 10 is counts = [0, 1023]"
    )
    value: Pair = Field(description="the values at these readings")

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        if (self.counts is None) == (self.bits is None):
            raise InputError("an adc needs counts or bits, one of the two: {counts = [0, 1023], value = [-2.4, 2.4]}")
        if self.counts is not None and self.counts[0] == self.counts[1]:
            raise InputError(f"counts are [{self.counts[0]:g}, {self.counts[1]:g}]; give two different readings")
        if self.value[0] == self.value[1]:
            raise InputError(f"value is [{self.value[0]:g}, {self.value[1]:g}]; give two different values")
        return self

    def line(self) -> tuple[float, float, float, float]:
        """Two readings and their values."""
        low, high = self.counts if self.counts is not None else (0.0, float(2 ** (self.bits or 1) - 1))
        return low, high, *self.value


class Channel(_Part):
    """How the numbers of a column become a signal.

    value = sign (scale x + offset) in `unit`, where x is the number in the file (after `signed` or `sign_bit`, `adc`,
    `times` and `direction`). Then the value is converted to SI.
    """

    column: Text = Field(description="column of the file")
    name: Text = Field(default="", description="name in reports")
    unit: Text = Field(
        default="", description="unit of the value: V, mV, rad, deg, rev, counts, percent, ...; becomes SI"
    )
    scale: Number = Field(default=1.0, description="value = sign * (scale * number + offset)")
    offset: Number = Field(default=0.0, description="in the unit of the value")
    sign: Literal[1, -1] = Field(default=1, description="-1 turns the direction round")
    adc: Adc | None = Field(
        default=None,
        description="counts to values by two points, before scale; bits = 10 stands for counts = [0, 1023]",
    )
    base: Literal[10, 16] = Field(default=10, description="of the digits: 16 for hexadecimal words such as 1A2B")
    signed: Bits = Field(
        default=0, description="bits of a two's complement word that was logged without its sign; 0: none"
    )
    sign_bit: Annotated[Whole, Field(ge=0, le=31)] = Field(
        default=0, description="bit, from 0, that says minus in a word of sign and magnitude, such as 15; 0: none"
    )
    times: Text = Field(default="", description="column that multiplies the number, such as the supply of a duty")
    direction: Text = Field(
        default="", description="column that turns the number round where it is 0 or below, as dir beside a duty does"
    )
    clock: Text = Field(default="", description='column of this channel\'s own time stamps; "": those of [clock]')
    every: Annotated[Whole, Field(ge=1)] = Field(
        default=1, description="rows in which each value of an output stands, whose sensor is slower than the log"
    )
    between: Literal["", "held", "line"] = Field(
        default="", description='between samples: "held" or "line"; "" is held for an input, a line for an output'
    )

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        if self.scale == 0:
            raise InputError("scale is 0, which makes a constant of the channel; give the value of one unit")
        if self.signed and self.sign_bit:
            raise InputError(f"signed is {self.signed} and sign_bit is {self.sign_bit}; give one of the two")
        for entry, column in (("times", self.times), ("direction", self.direction)):
            if column and column == self.column:
                raise MappingError(
                    (entry,),
                    f"{entry} is {brief_value(column)}, the column itself; name another one, or leave {entry} out",
                )
        return self

    def is_held(self, role: str) -> bool:
        """Whether the signal keeps its value between samples, else it follows a straight line."""
        return self.between == "held" or (self.between == "" and role == "input")


class Repair(_Part):
    """What is done about samples that are not where they should be."""

    duplicates: Literal["first", "mean", "refuse"] = Field(
        default="first", description='rows of one stamp: "first" keeps the first, "mean" averages them, or "refuse"'
    )
    backward: Literal["refuse", "drop"] = Field(
        default="refuse", description='a stamp that runs back: "refuse", or "drop" its row'
    )
    jitter: Annotated[Number, Field(ge=0, lt=0.5)] = Field(
        default=0.01,
        description="part of a step by which stamps may be off and still count as uniform; more is interpolated",
    )
    empty: Literal["refuse", "fill", "outputs"] = Field(
        default="refuse",
        description='cells without a value: "refuse", "fill" them like lost samples, or take those of "outputs" as '
        "missing, however many in a row",
    )
    longest_gap: Annotated[Whole, Field(ge=0)] = Field(
        default=3, description="lost samples in a row that are filled; a longer gap is refused"
    )
    most_lost: Annotated[Number, Field(ge=0, le=1)] = Field(
        default=0.1, description="part of the record that may be lost altogether"
    )


class Range(_Part):
    """The part of the file that is the record."""

    start: Number | None = Field(default=None, description="[s] after the first stamp; left out: from the first row")
    stop: Number | None = Field(default=None, description="[s] after the first stamp; left out: to the last row")
    active: Text = Field(
        default="", description="column that is not 0 while the record lasts: the first such rows are kept"
    )

    drive: Text = Field(
        default="", description="column that is 0 while the drive is off: each stretch that it is on is an experiment"
    )
    experiment: Text = Field(
        default="", description="column that numbers experiments, or a clock that starts again with each"
    )
    part: Annotated[Whole, Field(ge=1)] | None = Field(
        default=None, description="number of the experiment to keep, from 1; left out: all of them"
    )

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        if self.start is not None and self.stop is not None and not self.start < self.stop:
            raise InputError(f"start is {self.start:g} s and stop is {self.stop:g} s; give a start before the stop")
        return self


class ChannelMap(_Part):
    """From the columns of a file to the signals of a record; `other` are kept beside inputs and outputs."""

    clock: Clock = Clock()
    input: tuple[Channel, ...] = ()
    output: tuple[Channel, ...] = ()
    other: tuple[Channel, ...] = ()
    repair: Repair = Repair()
    range: Range = Range()

    def channels(self) -> list[tuple[str, Channel, str]]:
        """Role, channel and entry of the file ("input", or "input 1" of several) of every channel."""
        several = {role: len(getattr(self, role)) > 1 for role in ROLES}
        return [
            (role, channel, f"{role} {k}" if several[role] else role)
            for role in ROLES
            for k, channel in enumerate(getattr(self, role), start=1)
        ]

    def within(self, start: float | None, stop: float | None) -> "ChannelMap":
        """The mapping with these ends [s] of its range."""
        return self.model_copy(update={"range": self.range.model_copy(update={"start": start, "stop": stop})})

    def columns(self) -> dict[str, str]:
        """Every column that is read, and the entry of the file that names it."""
        entries = {self.clock.column: "clock.column"}
        entries |= {self.range.active: "range.active", self.range.drive: "range.drive"}
        entries |= {self.range.experiment: "range.experiment"}
        for _, channel, entry in self.channels():
            entries.setdefault(channel.column, f"{entry}.column")
            entries.setdefault(channel.times, f"{entry}.times")
            entries.setdefault(channel.direction, f"{entry}.direction")
            entries.setdefault(channel.clock, f"{entry}.clock")
        entries.pop("", None)
        return entries


ROLES = ("input", "output", "other")
