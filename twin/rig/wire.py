"""What host and firmware say to each other: messages and their payloads, states, refusals and faults.

The numbers are those of docs/rig-protocol.md; `twin.rig.frames` puts messages onto the line.
"""

import struct
from dataclasses import astuple, dataclass
from typing import ClassVar

from sysid.base.errors import InputError

VERSION = 1
BAUD = 115_200
FULL = 1023  # duty of the whole supply
RING = 256  # levels that the firmware keeps, of each joint
JOINTS = 3
PAYLOAD = 56  # bytes
ALIVE_EVERY, LINK = 0.01, 0.04  # [s] between two ALIVE, and without a good frame until the drive goes off
STORM = 8  # bad frames in a row
IDLE_RATE = 20.0  # [Hz] of SAMPLE while nothing runs
HALF_MS = 0.0005  # [s], the unit of a period
OFF, ARMED, RUNNING, ENDED, FAILED = range(5)  # states
STATES = ("off", "armed", "running", "ended", "in fault")
NO_JOINT = 255
REVERSED, USED = 1, 2  # flags of SETUP

REFUSALS = {
    1: "it is not in a state for this",
    2: "a value is out of its range",
    3: "no joint is used, or levels are missing",
    4: "a reading is not within the range of a working sensor",
    5: "too few levels were sent",
    6: "the ring is full",
    7: "levels are missing before these",
    8: "the stop key is pressed",
    9: "there is no supply",
}
STATE, VALUE, SETUP, SENSOR, FEW, ROOM, GAP, KEY, NO_SUPPLY = REFUSALS
FAULTS = {
    1: "it was stopped",
    2: "the link was lost",
    3: "the line is noisy: many frames in a row were damaged",
    4: "it did not move under drive (stall)",
    5: "its sensor has no believable reading",
    6: "it moved faster than its limit (strike)",
    7: "it moved against its drive",
    8: "the supply was lost",
    9: "the levels came too slowly",
    10: "the control loop was too slow",
}
STOPPED, LINK_LOST, NOISY, STALL, NO_SENSOR, STRIKE, DIRECTION, SUPPLY_LOST, STARVED, OVERRUN = FAULTS


class Damaged(ValueError):  # noqa: N818 - reads as what it says
    """Bytes that are no frame of this protocol."""


@dataclass(frozen=True)
class Message:
    """A message of either side: its type, and its payload as bytes."""

    code: ClassVar[int] = 0

    def pack(self) -> bytes:
        """The payload. Raises InputError for a number that its field cannot hold."""
        raise NotImplementedError

    @classmethod
    def unpack(cls, payload: bytes) -> "Message":
        """The message of a payload. Raises Damaged for one of another length."""
        raise NotImplementedError


@dataclass(frozen=True)
class Plain(Message):
    """A message whose payload is its fields, one after the other, in `layout`."""

    layout: ClassVar[str] = "<"

    def pack(self) -> bytes:
        """The payload. Raises InputError for a number that its field cannot hold."""
        try:
            return struct.pack(self.layout, *astuple(self))
        except struct.error as error:
            raise InputError(f"{type(self).__name__.upper()} cannot hold {astuple(self)} ({error})") from None

    @classmethod
    def unpack(cls, payload: bytes) -> "Plain":
        """The message of a payload. Raises Damaged for another length."""
        if len(payload) != struct.calcsize(cls.layout):
            raise Damaged(f"{cls.__name__.upper()} has {len(payload)} bytes")
        return cls(*struct.unpack(cls.layout, payload))


@dataclass(frozen=True)
class Hello(Plain):
    """Who is there?"""

    code: ClassVar[int] = 0x01
    layout: ClassVar[str] = "<B"
    protocol: int = VERSION


@dataclass(frozen=True)
class Setup(Plain):
    """The limits of a joint, in counts, duty and ms."""

    code: ClassVar[int] = 0x02
    layout: ClassVar[str] = "<B7HB"
    joint: int
    low: int
    high: int
    strike: int
    duty: int
    slew: int
    stall: int
    motion: int
    flags: int


@dataclass(frozen=True)
class Levels(Message):
    """Levels [duty] of all used joints from number `index` on: `values` has n of each joint, level by level."""

    code: ClassVar[int] = 0x03
    index: int
    n: int
    values: tuple[int, ...]

    def pack(self) -> bytes:
        """The payload."""
        try:
            return struct.pack(f"<HB{len(self.values)}h", self.index, self.n, *self.values)
        except struct.error as error:
            raise InputError(f"LEVELS cannot hold these numbers ({error})") from None

    @classmethod
    def unpack(cls, payload: bytes) -> "Levels":
        """The message of a payload. Raises Damaged for a length that does not fit its number of levels."""
        count, odd = divmod(len(payload) - 3, 2)
        if count < 0 or odd or (payload[2] and count % payload[2]) or (count and not payload[2]):
            raise Damaged(f"LEVELS has {len(payload)} bytes")
        index, n = struct.unpack("<HB", payload[:3])
        return cls(index, n, struct.unpack(f"<{count}h", payload[3:]))


@dataclass(frozen=True)
class Arm(Plain):
    """Make ready: period of a sample [0.5 ms], number of samples, samples for which each level is held."""

    code: ClassVar[int] = 0x04
    layout: ClassVar[str] = "<3H"
    period: int
    samples: int
    hold: int


@dataclass(frozen=True)
class Start(Plain):
    """Play."""

    code: ClassVar[int] = 0x05


@dataclass(frozen=True)
class Stop(Plain):
    """Drive off."""

    code: ClassVar[int] = 0x06


@dataclass(frozen=True)
class Alive(Plain):
    """The host is there."""

    code: ClassVar[int] = 0x07


@dataclass(frozen=True)
class Identity(Plain):
    """Who answers HELLO; `clock` [Hz] is the processor's, `full` the counts of a full reading."""

    code: ClassVar[int] = 0x81
    layout: ClassVar[str] = "<5B2HI16s"
    protocol: int
    major: int
    minor: int
    patch: int
    joints: int
    ring: int
    full: int
    clock: int
    raw_name: bytes

    @property
    def name(self) -> str:
        """The firmware's name."""
        return self.raw_name.rstrip(b"\0").decode("ascii", "replace")

    @property
    def firmware(self) -> str:
        """The firmware's version."""
        return f"{self.major}.{self.minor}.{self.patch}"

    @property
    def release(self) -> str:
        """Name and version."""
        return f"{self.name} {self.firmware}"


@dataclass(frozen=True)
class Done(Plain):
    """The answer to the frame `sequence` of type `answered`: 0, or the number of a refusal."""

    code: ClassVar[int] = 0x82
    layout: ClassVar[str] = "<3B"
    answered: int
    sequence: int
    reason: int


@dataclass(frozen=True)
class Sample(Message):
    """A reading: per joint (counts, duty that is played from then on), then what holds for all.

    `clock` [us] wraps after 71 minutes. `supply` [counts], `limits` are bits of joints, `free` the room of the ring,
    `dropped` the damaged frames that the firmware has counted.
    """

    code: ClassVar[int] = 0x83
    number: int
    clock: int
    joints: tuple[tuple[int, int], ...]
    supply: int
    state: int
    limits: int
    free: int
    dropped: int

    def pack(self) -> bytes:
        """The payload."""
        parts = [struct.pack("<HI", self.number, self.clock), *(struct.pack("<Hh", *joint) for joint in self.joints)]
        return b"".join(parts) + struct.pack("<HBBHB", self.supply, self.state, self.limits, self.free, self.dropped)

    @classmethod
    def unpack(cls, payload: bytes) -> "Sample":
        """The message of a payload. Raises Damaged for another length."""
        count, odd = divmod(len(payload) - 13, 4)
        if odd or not 1 <= count <= JOINTS:
            raise Damaged(f"SAMPLE has {len(payload)} bytes")
        number, clock = struct.unpack_from("<HI", payload)
        pairs = tuple((reading, duty) for reading, duty in struct.iter_unpack("<Hh", payload[6 : 6 + 4 * count]))
        return cls(number, clock, pairs, *struct.unpack_from("<HBBHB", payload, 6 + 4 * count))


@dataclass(frozen=True)
class Fault(Plain):
    """The drive went off by itself; `clock` [us]."""

    code: ClassVar[int] = 0x84
    layout: ClassVar[str] = "<BBI"
    reason: int
    joint: int
    clock: int


FROM_HOST: dict[int, type[Message]] = {kind.code: kind for kind in (Hello, Setup, Levels, Arm, Start, Stop, Alive)}
FROM_FIRMWARE: dict[int, type[Message]] = {kind.code: kind for kind in (Identity, Done, Sample, Fault)}
