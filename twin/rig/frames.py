"""Messages as bytes on the line, and a receiver that counts what is damaged: check sum, COBS, and a zero at the end."""

import struct
from binascii import crc_hqx
from dataclasses import dataclass, field

from twin.rig import wire

LONGEST = wire.PAYLOAD + 5  # bytes of an encoded frame without its zero: type, sequence, check sum and COBS


def check_sum(body: bytes) -> int:
    """CRC-16/CCITT-FALSE."""
    return crc_hqx(body, 0xFFFF)


def stuff(body: bytes) -> bytes:
    """A body of less than 254 bytes without zeros (COBS: Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999)."""
    return b"".join(bytes([len(part) + 1]) + part for part in body.split(b"\0"))


def unstuff(line: bytes) -> bytes:
    """The body of a line that `stuff` made. Raises wire.Damaged for one that it cannot have made."""
    parts, place = [], 0
    while place < len(line):
        end = place + line[place]
        if end > len(line):
            raise wire.Damaged("a frame ends too early")
        parts.append(line[place + 1 : end])
        place = end
    return b"\0".join(parts)


def frame(message: wire.Message, sequence: int) -> bytes:
    """A message as its frame, with the zero at the end."""
    body = bytes([message.code, sequence & 0xFF]) + message.pack()
    return stuff(body + struct.pack("<H", check_sum(body))) + b"\0"


def message_of(line: bytes, kinds: dict[int, type[wire.Message]]) -> tuple[int, wire.Message]:
    """Sequence number and message of a frame without its zero. Raises wire.Damaged."""
    if len(line) > LONGEST:
        raise wire.Damaged(f"a frame of {len(line)} bytes")
    body = unstuff(line)
    if len(body) < 4 or check_sum(body[:-2]) != int.from_bytes(body[-2:], "little"):
        raise wire.Damaged("wrong check sum")
    if body[0] not in kinds:
        raise wire.Damaged(f"unknown type {body[0]:#04x}")
    return body[1], kinds[body[0]].unpack(body[2:-2])


@dataclass
class Receiver:
    """Messages from bytes in pieces of any size; counts damaged frames, and those that are missing by their numbers.

    `row` is the number of damaged frames since the last good one.
    """

    kinds: dict[int, type[wire.Message]]
    bad: int = 0
    row: int = 0
    missing: int = 0
    _rest: bytearray = field(default_factory=bytearray)
    _last: int | None = None

    def feed(self, data: bytes) -> list[tuple[int, wire.Message]]:
        """The messages that end in `data`, with their sequence numbers."""
        *lines, rest = (bytes(self._rest) + data).split(b"\0")
        self._rest = bytearray(rest[-4 * LONGEST :])  # what never ends is no frame
        found = []
        for line in filter(None, lines):
            try:
                sequence, message = message_of(line, self.kinds)
            except wire.Damaged:
                self.bad += 1
                self.row += 1
                continue
            self.row = 0
            if self._last is not None:
                self.missing += (sequence - self._last - 1) % 256
            self._last = sequence
            found.append((sequence, message))
        return found
