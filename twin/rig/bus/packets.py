"""Packets as a servo sees them, written from the makers' protocol pages: instructions in, status packets out.

Dynamixel: protocol 2.0 of the ROBOTIS e-manual. Feetech: the communication protocol of SCS and STS servos.
"""

from dataclasses import dataclass

PING, READ, WRITE, REG_WRITE, ACTION, SYNC_READ, SYNC_WRITE = 1, 2, 3, 4, 5, 0x82, 0x83
STATUS = 0x55  # in place of an instruction, in protocol 2.0
EVERYBODY = 0xFE
SHORTEST = {"feetech": 6, "dynamixel": 10}


@dataclass(frozen=True)
class Instruction:
    """What the host wants of the servo `number`, or of everybody."""

    number: int
    code: int
    parameters: bytes


def crc16(data: bytes) -> int:
    """Of protocol 2.0: polynomial 0x8005, from 0, not reflected."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1) ^ (0x8005 if value & 0x8000 else 0)
        value &= 0xFFFF
    return value


def taken(family: str, buffer: bytearray) -> list[Instruction]:
    """The whole instructions at the front of `buffer`, which keeps what is not whole; damaged ones are dropped."""
    found: list[Instruction] = []
    head = b"\xff\xff" if family == "feetech" else b"\xff\xff\xfd\0"
    while True:
        start = buffer.find(head)
        if start < 0:
            del buffer[: max(len(buffer) - len(head) + 1, 0)]
            return found
        del buffer[:start]
        if len(buffer) < SHORTEST[family]:
            return found
        length = buffer[3] + 4 if family == "feetech" else int.from_bytes(buffer[5:7], "little") + 7
        if not SHORTEST[family] <= length <= 1024:
            del buffer[:1]
            continue
        if len(buffer) < length:
            return found
        packet = bytes(buffer[:length])
        instruction = _feetech(packet) if family == "feetech" else _dynamixel(packet)
        del buffer[: length if instruction else 1]
        if instruction:
            found.append(instruction)


def _feetech(packet: bytes) -> Instruction | None:
    if packet[-1] != ~sum(packet[2:-1]) & 0xFF:
        return None
    return Instruction(packet[2], packet[4], packet[5:-1])


def _dynamixel(packet: bytes) -> Instruction | None:
    if int.from_bytes(packet[-2:], "little") != crc16(packet[:-2]):
        return None
    return Instruction(packet[4], packet[7], packet[8:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd"))


def status(family: str, number: int, error: int, data: bytes) -> bytes:
    """The answer of a servo."""
    if family == "feetech":
        body = bytes([number, len(data) + 2, error]) + data
        return b"\xff\xff" + body + bytes([~sum(body) & 0xFF])
    body = (bytes([STATUS, error]) + data).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    packet = b"\xff\xff\xfd\0" + bytes([number]) + (len(body) + 2).to_bytes(2, "little") + body
    return packet + crc16(packet).to_bytes(2, "little")


def addressed(family: str, parameters: bytes) -> tuple[int, int, bytes]:
    """Address, number of bytes and the rest of the parameters of a read or a sync instruction."""
    if family == "feetech":
        return parameters[0], parameters[1], parameters[2:]
    return int.from_bytes(parameters[:2], "little"), int.from_bytes(parameters[2:4], "little"), parameters[4:]


def written(family: str, parameters: bytes) -> tuple[int, bytes]:
    """Address and bytes of a write."""
    if family == "feetech":
        return parameters[0], parameters[1:]
    return int.from_bytes(parameters[:2], "little"), parameters[2:]
