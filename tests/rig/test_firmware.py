"""The real firmware: its C against what Python says independently, and its .elf executed by simavr."""

import ctypes
import itertools
import os
import re
import select
import subprocess
import tty

import numpy as np
import pytest

from sysid.base.errors import InputError
from twin.rig import avr, frames, wire
from twin.rig.avr import Avr, Port
from twin.rig.faults import KINDS, healthy, outcome
from twin.rig.scripted import FULL, HIGH, HOLD, LOW, Legs, Run, random_levels

pytestmark = pytest.mark.skipif(bool(avr.missing()), reason=avr.missing())
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-DF_CPU=16000000UL")


def crc_bit_by_bit(data: bytes) -> int:
    """CRC-16/CCITT-FALSE by its definition: polynomial 0x1021, from 0xFFFF, highest bit first."""
    register = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            top = register >> 15 ^ byte >> bit & 1
            register = (register << 1 & 0xFFFF) ^ 0x1021 * top
    return register


def framed(body: bytes) -> bytes:
    """A body with its check sum as COBS describes it: each zero becomes the distance to the next."""
    data = bytearray(b"\0" + body + crc_bit_by_bit(body).to_bytes(2, "little") + b"\0")
    zeros = [k for k, byte in enumerate(data) if byte == 0]
    for here, following in itertools.pairwise(zeros):
        data[here] = following - here
    return bytes(data)


@pytest.fixture(scope="module")
def c_code(tmp_path_factory):
    """The parts of the firmware that need no registers, compiled for this computer without a warning."""
    out = tmp_path_factory.mktemp("host") / "firmware.so"
    sources = [str(avr.FIRMWARE / name) for name in ("wire.c", "safety.c")]
    subprocess.run(["gcc", *FLAGS, "-shared", "-fPIC", "-o", str(out), *sources], check=True)
    library = ctypes.CDLL(str(out))
    library.wire_crc.restype = ctypes.c_uint16
    return library


@pytest.fixture
def still():
    """Joints that stand at 0.3, 0.5 and 0.7 of a full reading, whatever is played."""
    legs = Legs(np.random.default_rng(0))
    legs.held = {0: 0.3, 1: 0.5, 2: 0.7}
    return legs


def levels_of(*rows: tuple[int, int, int]) -> np.ndarray:
    return np.array(rows)


def test_the_check_sum_is_the_one_of_the_catalogue(c_code):
    assert c_code.wire_crc(b"123456789", 9) == 0x29B1 == crc_bit_by_bit(b"123456789")
    rng = np.random.default_rng(1)
    for n in range(1, 61):
        data = rng.integers(0, 256, n, dtype=np.uint8).tobytes()
        assert c_code.wire_crc(data, n) == crc_bit_by_bit(data)


def test_frames_are_those_of_cobs(c_code):
    rng = np.random.default_rng(2)
    for n in (*range(57), 56, 56):
        payload = (rng.integers(0, 256, n) * (rng.random(n) > 0.3)).astype(np.uint8).tobytes()
        out = ctypes.create_string_buffer(80)
        length = c_code.wire_frame(out, 0x83, n, payload, n)
        assert out.raw[:length] == framed(bytes([0x83, n]) + payload)


def test_a_frame_is_taken_whole_or_not_at_all(c_code):
    rng = np.random.default_rng(3)
    lengths = {0x01: 1, 0x02: 16, 0x03: 51, 0x04: 6, 0x05: 0, 0x06: 0, 0x07: 0}
    for code, n in lengths.items():
        body = bytes([code, 7]) + rng.integers(0, 256, n, dtype=np.uint8).tobytes()
        frame = framed(body)[:-1]
        data = ctypes.create_string_buffer(frame, len(frame))
        assert c_code.wire_body(data, len(frame)) == len(body)
        assert data.raw[: len(body)] == body
        for _ in range(300):
            bad = bytearray(frame)
            bad[rng.integers(len(bad))] ^= int(rng.integers(1, 256))
            assert c_code.wire_body(ctypes.create_string_buffer(bytes(bad), len(bad)), len(bad)) == 0
        for cut in range(len(frame)):
            assert c_code.wire_body(ctypes.create_string_buffer(frame[:cut], cut + 1), cut) == 0
    for body in (b"\x01\x00", b"\x02\x00" + bytes(15), b"\x05\x00\x00", b"\x81\x00" + bytes(29), b"\x08\x00"):
        frame = framed(body)[:-1]
        assert c_code.wire_body(ctypes.create_string_buffer(frame, len(frame)), len(frame)) == 0


def test_both_sides_have_the_same_numbers():
    text = (avr.FIRMWARE / "wire.h").read_text(encoding="utf-8")
    numbers = {name: int(value, 0) for name, value in re.findall(r"#define ([A-Z]\w+) (0x\w+|\d+)", text)}
    types = {kind.__name__.upper(): code for code, kind in (wire.FROM_HOST | wire.FROM_FIRMWARE).items()}
    assert {name: numbers[f"WIRE_{name}"] for name in types} == types
    found = {prefix: sorted(v for n, v in numbers.items() if n.startswith(prefix)) for prefix in ("FAULT_", "REFUSED_")}
    assert found == {"FAULT_": sorted(wire.FAULTS), "REFUSED_": sorted(wire.REFUSALS)}
    ours = (wire.VERSION, wire.BAUD, wire.FULL, wire.RING, wire.JOINTS, wire.PAYLOAD, 1000 * wire.LINK, wire.STORM)
    names = ("VERSION", "BAUD", "LARGEST_DUTY", "RING", "JOINTS", "LARGEST_PAYLOAD", "SILENCE_MS", "STORM")
    assert tuple(numbers[f"WIRE_{name}"] for name in names) == ours
    assert [numbers[f"STATE_{name}"] for name in ("OFF", "ARMED", "RUNNING", "ENDED", "FAULT")] == [
        wire.OFF,
        wire.ARMED,
        wire.RUNNING,
        wire.ENDED,
        wire.FAILED,
    ]


def test_it_fits_the_board():
    out = subprocess.run(["avr-size", str(avr.build() / "firmware.elf")], capture_output=True, text=True, check=True)
    text, data, bss = map(int, out.stdout.splitlines()[1].split()[:3])
    print(f"flash {text + data} bytes, RAM {data + bss} bytes without the stack")
    assert text + data < 12_000  # of 256 KB
    assert data + bss < 4_000  # of 8 KB


def test_three_joints_at_200_hz_lose_no_sample_and_are_sampled_within_50_us():
    legs = Legs(np.random.default_rng(4))
    levels = random_levels(np.random.default_rng(5), 45)
    conversions, loads, places = [], [], {}
    with Avr(legs, noise=0.0) as board:
        run = Run(board, legs, levels)
        run.prepare()
        run.start()
        while run.samples == [] or run.samples[-1].state == wire.RUNNING:
            places[round(board.time * 1000)] = legs.place.copy()
            run.go_on()
            conversions += board.conversions
            loads.append(board.load)
    assert [sample.number for sample in run.samples] == list(range(900))
    assert run.samples[-1].state == wire.ENDED
    assert {b.clock - a.clock for a, b in itertools.pairwise(run.samples)} == {5000}
    assert (run.receiver.bad, run.receiver.missing, run.samples[-1].dropped) == (0, 0, 0)
    times = np.array([cycle for cycle, _ in conversions]) / 16.0  # [us]
    first = int(np.argmax(np.diff(times) > 70.0)) + 1  # between two milliseconds the converter rests
    scans = len(times[first:]) // 16
    times = times[first : first + 16 * scans].reshape(scans, 16)
    jitter = np.ptp(times - 1000.0 * np.arange(scans)[:, None], axis=0)
    print(f"jitter of the first conversion {jitter[0]:.1f} us, of the latest of 16 {jitter.max():.1f} us, 1 kHz")
    print(f"load {np.mean(loads):.2f}, in the busiest millisecond {np.max(loads):.2f}")
    assert jitter.max() < 50.0
    assert np.max(loads) < 1.0
    # A reading is the place in the millisecond before it; the plant was asked at its begin, give or take one.
    for sample in run.samples[5::50]:
        shown = np.array([reading for reading, _ in sample.joints]) / FULL
        near = [places[sample.clock // 1000 + k] for k in range(-2, 2)]
        assert np.all(shown >= np.min(near, axis=0) - 2e-3)
        assert np.all(shown <= np.max(near, axis=0) + 2e-3)


def test_what_is_played_is_the_level_after_slew_limit_and_the_sign(still):
    with Avr(still) as board:
        run = Run(board, still, levels_of((300, -700, 1023), (300, -700, 1023)), hold=10)
        for _ in range(5):
            run.step()
        for joint in range(3):
            flags = wire.USED | (wire.REVERSED if joint == 1 else 0)
            assert run.ask(wire.Setup(joint, 400, 3700, 9000, 600, 100, 9000, 100, flags)) == 0
        assert run.ask(run.send_levels()) == 0
        assert run.ask(wire.Arm(10, 20, 10)) == 0
        run.start()
        played = []
        while len(run.samples) < 20:
            run.go_on()
            played.append(board.duties)
        ramp = {level: [np.sign(level) * min(100 * k, abs(level)) for k in range(1, 101)] for level in (300, -600, 600)}
        for joint, level in enumerate((300, -600, 600)):
            told = [sample.joints[joint][1] for sample in run.samples]
            assert told == [round(float(np.mean(ramp[level][k : k + 5]))) for k in range(0, 100, 5)]
        steady = np.array(played[30:60])
        assert steady == pytest.approx(np.tile(np.array([300, 600, 600]) / 1023, (30, 1)), abs=1e-6)
        assert run.samples[3].joints[0][0] == pytest.approx(0.3 * FULL, abs=6)
        assert board.enabled == 0


def test_nothing_moves_before_start_and_after_the_end(still):
    with Avr(still) as board:
        run = Run(board, still, levels_of((500, 500, 500)))
        run.prepare()
        for _ in range(100):
            run.say(wire.Alive())
            run.step()
        assert run.samples == []  # armed, and silent
        assert board.last_on == 0.0
        run.start()
        run.go_on()
        while run.samples[-1:] == [] or run.samples[-1].state == wire.RUNNING:
            run.go_on()
        end = board.last_on
        assert end > 0.0
        for _ in range(200):
            run.go_on()
        assert board.last_on == end
        assert board.time - end > 0.15
        idle = [sample for sample in run.samples if len(sample.joints) == 3][-3:]
        assert {b.clock - a.clock for a, b in itertools.pairwise(idle)} == {50_000}


def test_what_is_refused_is_refused_with_its_reason(still):
    with Avr(still) as board:
        run = Run(board, still, levels_of((100, 100, 100), (0, 0, 0)))
        for _ in range(5):
            run.step()
        arm, start, good = wire.Arm(10, 40, 20), wire.Start(), run.set_up(0)
        assert run.ask(start) == wire.STATE
        assert run.ask(arm) == wire.SETUP
        assert run.ask(run.send_levels()) == wire.SETUP
        assert run.ask(wire.Setup(3, *[1] * 7, wire.USED)) == wire.VALUE
        assert run.ask(wire.Setup(0, 900, 800, 9000, 500, 50, 200, 20, wire.USED)) == wire.VALUE
        assert run.ask(wire.Setup(0, 500, 800, 9000, 0, 50, 200, 20, wire.USED)) == wire.VALUE
        for joint in range(3):
            assert run.ask(run.set_up(joint)) == 0
        assert run.ask(wire.Levels(5, 1, (0, 0, 0))) == wire.GAP
        assert run.ask(wire.Levels(0, 1, (0, 1024, 0))) == wire.VALUE
        assert run.ask(wire.Levels(0, 2, (0, 0, 0))) == wire.SETUP
        assert run.ask(arm) == wire.FEW
        for first in (0, 0):  # received twice, it counts once
            assert run.ask(wire.Levels(first, 2, (100, 100, 100, 0, 0, 0))) == 0
        for odd in (wire.Arm(11, 40, 20), wire.Arm(4, 40, 20), wire.Arm(10, 0, 20), wire.Arm(10, 40, 0)):
            assert run.ask(odd) == wire.VALUE  # not of whole ms, faster than the line, or empty
        assert run.ask(wire.Arm(10, 41, 20)) == wire.FEW
        still.held[1] = 0.005
        run.step()
        assert run.ask(arm) == wire.SENSOR
        still.held[1], board.key = 0.5, True
        assert run.ask(arm) == wire.KEY
        board.key, still.supply = False, 0.0
        assert run.ask(arm) == wire.NO_SUPPLY
        still.supply = 0.7
        for _ in range(20):  # a reading that has just jumped would be a joint that is too fast
            run.step()
        assert run.ask(arm) == 0
        assert run.ask(good) == wire.STATE
        run.start()
        assert run.ask(arm) == wire.STATE
        assert run.faults == []


def test_the_ring_says_when_it_is_full(still):
    with Avr(still) as board:
        run = Run(board, still, np.zeros((wire.RING + 8, 3), dtype=int))
        run.prepare()
        assert run.sent == wire.RING
        assert run.ask(run.send_levels()) == wire.ROOM


def test_beyond_a_limit_only_the_way_back_is_driven(still):
    still.held = {0: LOW - 0.02, 1: 0.5, 2: HIGH + 0.02}
    with Avr(still) as board:
        run = Run(board, still, levels_of((-500, 0, 500), (150, 0, -150)), hold=10)
        run.prepare()
        run.start()
        while len(run.samples) < 20:
            run.go_on()
    outward, inward = run.samples[5], run.samples[15]
    assert ([duty for _, duty in outward.joints], outward.limits) == ([0, 0, 0], 0b100001)
    assert ([duty for _, duty in inward.joints], inward.limits) == ([150, 0, -150], 0)
    assert run.faults == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_drives_off_in_time(kind):
    result = outcome(kind, seed=1000)
    print(f"{kind}: {1000 * result.late:.1f} ms after it could be seen, told as {result.reason}")
    assert result.met, result


def test_a_run_without_a_fault_goes_to_its_end_on_a_line_that_damages_frames():
    run = healthy(1000, seconds=5.0)
    assert (run.reason, run.missing, run.samples) == (0, 0, 1000)


def test_after_a_fault_it_plays_again_when_it_is_armed_again(still):
    with Avr(still) as board:
        run = Run(board, still, levels_of((150, 150, 150)))
        run.prepare()
        run.start()
        run.say(wire.Stop())
        for _ in range(150):
            run.step()
        assert [fault.reason for fault in run.faults] == [wire.STOPPED] * 3  # two in case the first is lost
        assert len({fault.clock for fault in run.faults}) == 1
        assert run.ask(wire.Start()) == wire.STATE
        assert run.ask(wire.Arm(10, HOLD, HOLD)) == wire.FEW
        run.sent = 0
        run.prepare()
        run.start()
        while run.samples[-1:] == [] or run.samples[-1].state == wire.RUNNING:
            run.go_on()
        assert run.samples[-1].number == HOLD - 1


def test_a_host_opens_the_simulated_board_like_a_port(still):
    board = Avr(still)
    for _ in range(5):  # it starts
        board.step()
    with Port(board) as port:
        handle = os.open(port.port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(handle)
        os.write(handle, frames.frame(wire.Hello(), 0))
        receiver, answers = frames.Receiver(wire.FROM_FIRMWARE), []
        while not answers and select.select([handle], [], [], 10.0)[0]:
            answers = receiver.feed(os.read(handle, 100))
        os.close(handle)
    (identity,) = (message for _, message in answers)
    assert identity == wire.Identity(1, 0, 1, 0, 3, 256, FULL, 16_000_000, b"qpal-mega2560\0\0\0")


def test_a_missing_compiler_is_a_sentence(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="gcc-avr, avr-libc"):
        avr.build()
