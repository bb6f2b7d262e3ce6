"""Frames of the rig's protocol: what is sent arrives, and nothing that was damaged does."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sysid.base.errors import InputError
from twin.rig import frames, wire

MESSAGES = [
    wire.Hello(),
    wire.Setup(1, 0, 1023, 400, 1023, 40, 3000, 4, wire.USED),
    wire.Levels(300, 2, (-1023, 0, 256, 1023, -1, 1)),
    wire.Arm(40, 6000, 1),
    wire.Start(),
    wire.Stop(),
    wire.Alive(),
    wire.Identity(1, 0, 1, 2, 3, 256, 1023, 16_000_000, b"qpal rig".ljust(16, b"\0")),
    wire.Done(3, 255, 0),
    wire.Sample(65535, 2**32 - 1, ((512, -1023), (0, 0), (1023, 1023)), 700, 2, 33, 256, 255),
    wire.Fault(4, 0, 123456),
]
KINDS = wire.FROM_HOST | wire.FROM_FIRMWARE


def bitwise_crc(data: bytes) -> int:
    """CRC-16/CCITT-FALSE by long division: polynomial 0x1021, start 0xFFFF, the highest bit first."""
    crc = 0xFFFF
    for byte in data:
        for k in range(7, -1, -1):
            carry = (crc >> 15) ^ (byte >> k & 1)
            crc = (crc << 1 & 0xFFFF) ^ (0x1021 if carry else 0)
    return crc


def test_check_sum_is_the_published_one():
    assert frames.check_sum(b"123456789") == bitwise_crc(b"123456789") == 0x29B1  # the catalogue's check value


def test_frames_are_those_of_the_page():
    """HELLO with sequence number 0, byte by byte: COBS takes the zero of the sequence number."""
    body = bytes([0x01, 0, 1])
    crc = struct.pack("<H", bitwise_crc(body))
    assert b"\0" not in crc
    assert frames.frame(wire.Hello(), 0) == bytes([2, 0x01, 4, 1]) + crc + b"\0"


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_a_message_comes_back(message):
    line = frames.frame(message, 300)
    assert line.count(0) == 1
    assert len(line) <= frames.LONGEST + 1
    assert frames.message_of(line[:-1], KINDS) == (300 % 256, message)


@given(st.binary(max_size=60))
def test_no_body_has_a_zero_on_the_line(body):
    line = frames.stuff(body)
    assert 0 not in line
    assert len(line) == len(body) + 1
    assert frames.unstuff(line) == body


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_no_single_bit_is_wrong_unseen(message):
    """Every bit of every byte turned: the receiver drops the frame and counts it, and takes the next."""
    line = frames.frame(message, 7)
    after = frames.frame(wire.Done(1, 1, 0), 8)
    for k in range(8 * (len(line) - 1)):
        damaged = bytearray(line)
        damaged[k // 8] ^= 1 << k % 8
        receiver = frames.Receiver(KINDS)
        found = receiver.feed(bytes(damaged) + after)
        assert found == [(8, wire.Done(1, 1, 0))], k
        assert receiver.bad >= 1
        assert receiver.row == 0


def test_pieces_of_any_size_give_the_same_messages():
    stream = b"".join(frames.frame(message, k) for k, message in enumerate(MESSAGES))
    rng = np.random.default_rng(0)
    for _ in range(20):
        cuts = np.sort(rng.integers(0, len(stream), 12))
        receiver, found = frames.Receiver(KINDS), []
        for piece in np.split(np.frombuffer(stream, np.uint8), cuts):
            found += receiver.feed(piece.tobytes())
        assert [message for _, message in found] == MESSAGES
        assert receiver.bad == receiver.missing == 0


def test_lost_frames_are_counted_by_their_numbers():
    receiver = frames.Receiver(KINDS)
    for sequence in (254, 255, 2, 3):
        receiver.feed(frames.frame(wire.Alive(), sequence))
    assert (receiver.missing, receiver.bad) == (2, 0)


def test_what_is_no_frame_of_ours_is_counted_and_forgotten():
    receiver = frames.Receiver(KINDS)
    assert receiver.feed(b"angle 12.5\r\n" * 1000 + b"\0\0\0" + b"\xff" * 10 + b"\0") == []
    assert (receiver.bad, receiver.row) == (2, 2)
    unknown = bytes([0x55, 0])
    receiver.feed(frames.stuff(unknown + struct.pack("<H", bitwise_crc(unknown))) + b"\0")
    assert receiver.bad == 3


def test_numbers_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="SETUP cannot hold"):
        frames.frame(wire.Setup(0, -1, 0, 0, 0, 0, 0, 0, 0), 0)
    with pytest.raises(InputError, match="LEVELS cannot hold"):
        frames.frame(wire.Levels(70000, 1, (1,)), 0)
