"""What goes wrong on a rig: the drive is off, the log up to there is whole, and a sentence says why."""

import os
import threading
import time

import numpy as np
import pytest

from sysid.base.errors import InputError
from twin.rig import frames, wire
from twin.rig import link as links
from twin.rig.calibration import SUPPLY_OFF
from twin.rig.link import Link, Lost
from twin.rig.run import Input, check_input, log_of, play
from twin.rig.wiring import check_rig, find_ends, find_wiring, read_sensors

TS = 0.02


def driven(emulator) -> bool:
    """Whether the bridge gets a voltage, now or from what is on its way."""
    return emulator.board.state in (wire.ARMED, wire.RUNNING) or any(emulator.plant._queue)


def to_and_fro(N=600):
    return np.where(np.arange(N) // 60 % 2 == 0, 7.0, -7.0)


def wait_for(condition, seconds=5.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return condition()


@pytest.mark.parametrize(
    ("trouble", "reason"),
    [
        ("unplugged", "its sensor has no believable reading"),
        ("stuck", "it did not move under drive"),
        ("reversed", "it moved against its drive"),
        ("no supply", "the supply was lost"),
    ],
)
def test_a_fault_ends_the_run_with_a_whole_log(rig, trouble, reason):
    with rig(changes={"stall": 0.8}) as (emulator, link, calibration):
        levels = check_input(Input(to_and_fro(), TS), calibration)

        def happen(share):
            if share >= 0.2 and not emulator.plant.trouble:
                emulator.plant.break_down(trouble)

        recording = play(link, calibration.setup(link.identity.full), levels, TS, happen)
        assert reason in recording.reason
        n = len(recording.counts)
        assert 0.2 * 600 <= n < 590
        assert wait_for(lambda: not driven(emulator))
        log = log_of(recording, calibration, link)
        assert len(log.y) == n
        assert not np.isnan(log.y).any()
        assert reason in log.meta["rig"]["ended_early"]
        # The rig works again once the trouble is over.
        emulator.plant.break_down("")
        again = play(link, calibration.setup(link.identity.full), levels[:50], TS)
        assert again.reason == ""


def test_too_fast_is_a_fault(rig):
    with rig(changes={"strike": 0.2}) as (_, link, calibration):
        levels = check_input(Input(to_and_fro(), TS), calibration)
        assert "faster than its limit" in play(link, calibration.setup(1023), levels, TS).reason


def test_a_pulled_cable_leaves_the_log_and_the_drive_goes_off(rig):
    with rig() as (emulator, link, calibration):
        levels = check_input(Input(to_and_fro(3000), TS), calibration)
        recording = play(
            link, calibration.setup(1023), levels, TS, lambda share: emulator.pull() if share > 0.05 else None
        )
        assert "connection is lost" in recording.reason
        assert 100 < len(recording.counts) < 3000
        assert not np.isnan(recording.counts).any()
        assert wait_for(lambda: not driven(emulator))
        with pytest.raises(Lost):
            link.send(wire.Hello())


def test_a_host_that_dies_leaves_the_drive_off(rig, monkeypatch):
    """Its process is gone: no STOP, no ALIVE, nobody who reads."""
    with rig() as (emulator, link, calibration):
        levels = check_input(Input(to_and_fro(6000), TS), calibration)
        dead = threading.Event()
        real = link.send

        def send(message):
            if dead.is_set():
                raise Lost("dead")
            return real(message)

        def die(share):
            dead.set()

        monkeypatch.setattr(link, "send", send)
        recording = play(link, calibration.setup(1023), levels, TS, die)
        assert recording.reason
        assert wait_for(lambda: not driven(emulator))
        assert emulator.board.state == wire.FAILED


def test_ctrl_c_stops_the_drive_and_keeps_the_log(rig):
    with rig() as (emulator, link, calibration):
        levels = check_input(Input(to_and_fro(3000), TS), calibration)

        def stop(share):
            if share > 0.05:
                raise KeyboardInterrupt

        recording = play(link, calibration.setup(1023), levels, TS, stop)
        assert recording.interrupted
        assert recording.reason == "it was stopped by hand"
        assert len(recording.counts) > 100
        assert wait_for(lambda: not driven(emulator))


def test_another_thread_stops_the_drive_at_once_and_sees_what_comes(rig):
    """Each sample is seen once; STOP goes out at once, whatever the length of a sample is."""
    with rig(speed=1.5) as (emulator, link, calibration):
        levels = check_input(Input(to_and_fro(100), 5.0), calibration)
        threading.Timer(0.5, link.stop).start()
        began = time.monotonic()
        recording = play(link, calibration.setup(1023, 1000.0), levels, 5.0)
        assert time.monotonic() - began < 2.0
        assert recording.interrupted
        assert wait_for(lambda: not driven(emulator), 0.5)
        seen = []
        link.watch = seen.append
        recording = play(link, calibration.setup(1023), check_input(Input(to_and_fro(30), TS), calibration), TS)
        assert [sample.number for sample in seen if len(sample.joints) == 1] == [*range(30)]
        assert [s.joints[0][0] for s in seen if len(s.joints) == 1] == recording.counts.tolist()


def test_a_second_host_is_refused(rig):
    with rig() as (emulator, _, _), pytest.raises(InputError, match="another program holds this port"):
        Link(emulator.port)


@pytest.fixture
def device(monkeypatch):
    """A pseudo-terminal with a thread that answers with what `answer` makes of the bytes it got."""
    monkeypatch.setattr(links, "GREETING", 0.4)
    over, opened = threading.Event(), []

    def made(answer):
        master, slave = os.openpty()
        import tty

        tty.setraw(slave)
        os.set_blocking(master, False)

        def serve():
            while not over.wait(0.005):
                try:
                    data = os.read(master, 1000)
                except BlockingIOError:
                    continue
                os.write(master, answer(data))

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        opened.append((master, slave, thread))
        return os.ttyname(slave)

    yield made
    over.set()
    for master, slave, thread in opened:
        thread.join()
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (lambda data: b"", "nothing answers"),
        (lambda data: b"ok 12.5\r\n", "another device is on this port"),
        (lambda data: data, "another device is on this port"),  # an echo is no answer
        (
            lambda data: frames.frame(wire.Identity(2, 3, 0, 0, 3, 256, 1023, 16_000_000, b"rig".ljust(16, b"\0")), 0),
            "speaks version 2 of the protocol and this host version 1",
        ),
    ],
)
def test_a_port_with_something_else_gets_a_sentence(device, answer, said):
    with pytest.raises(InputError, match=said):
        Link(device(answer))


def test_a_port_that_is_none_gets_a_sentence(tmp_path):
    with pytest.raises(InputError, match="there is no such port; ports of this machine"):
        Link(str(tmp_path / "ttyACM0"))


def test_a_sensor_without_wires_is_told_before_anything_moves(rig):
    with rig() as (emulator, link, calibration):
        emulator.plant.break_down("unplugged")
        with pytest.raises(InputError, match="the edge of its range; check the potentiometer"):
            find_wiring(link, calibration, print)
        with pytest.raises(InputError, match="not within the range of a working sensor"):
            play(link, calibration.setup(1023), np.zeros(20, dtype=int), TS)


def test_another_board_and_another_supply_are_told_before_anything_moves(rig):
    """5 V of USB and resistors of 5 % may make 12 V of 10.5 to 13.5, and no more."""
    with rig() as (emulator, link, calibration):
        before = emulator.plant.position(0)
        for supply, holds in ((12.0, True), (13.5, True), (10.9, True), (13.8, False), (10.6, False), (24.0, False)):
            known = calibration.model_copy(update={"supply": supply, "board": "qpal twin 1.0.0, seed 1"})
            if holds:
                check_rig(link, known, "qpal twin 1.0.0, seed 1", "again")
                continue
            with pytest.raises(InputError, match=f"measures 12.0 V and should have {supply:g} V; 12% off is allowed"):
                check_rig(link, known, "qpal twin 1.0.0, seed 1", "again")
        with pytest.raises(InputError, match=r"board: qpal twin 1\.0\.0, seed 1; here answers Z: wire it by W"):
            check_rig(link, known, "Z", "W")
        emulator.plant.break_down("no supply")
        with pytest.raises(InputError, match=r"the supply measures 0.0 V .*: switch it on"):
            check_rig(link, calibration, "", "again")
        assert emulator.plant.position(0) == before
        assert emulator.board.state == wire.OFF


def test_the_least_and_the_most_that_a_good_divider_measures_is_allowed():
    """Each resistor and the 5 V of USB at their limits, in volts."""
    readings = [
        12.0 * r2 / (r1 + r2) / usb * 5.0 * 3.7
        for r1 in (27e3 * 0.95, 27e3 * 1.05)
        for r2 in (10e3 * 0.95, 10e3 * 1.05)
        for usb in (4.75, 5.25)
    ]
    off = [volts / 12.0 - 1.0 for volts in readings]
    assert max(map(abs, off)) == pytest.approx(SUPPLY_OFF, abs=0.015)  # which is of first order


def test_a_motor_without_wires_is_told(rig):
    with rig() as (_, link, calibration), pytest.raises(InputError, match="joint 2 does not move at full duty"):
        find_wiring(link, calibration.model_copy(update={"channel": 2}), lambda sentence: None)


def test_ctrl_c_ends_a_wire_check_and_not_only_its_pulse(rig, monkeypatch):
    with rig() as (emulator, link, calibration):
        real, calls = link.receive, iter(range(10_000))

        def receive():
            if emulator.board.state == wire.RUNNING and next(calls) == 2:
                raise KeyboardInterrupt
            return real()

        monkeypatch.setattr(link, "receive", receive)
        with pytest.raises(KeyboardInterrupt):
            find_wiring(link, calibration, lambda sentence: None)
        assert wait_for(lambda: not driven(emulator))


@pytest.mark.parametrize(("signs", "reversed_motor"), [((1, 1), False), ((-1, 1), True), ((-1, -1), False)])
def test_wiring_and_ends_are_found(rig, signs, reversed_motor):
    with rig(signs=signs) as (emulator, link, known):
        start = known.model_copy(update={"motor_reversed": not reversed_motor})
        found = find_wiring(link, start, lambda sentence: None)
        assert found.motor_reversed is reversed_motor
        stood = []

        def angle(end, counts):
            stood.append((end, read_sensors(link).mean[0] - counts))
            return emulator.plant.angle_of(counts)

        ends = find_ends(link, found, lambda sentence: None, angle)
        assert [end for end, _ in stood] == ["low", "high"]
        assert max(abs(off) for _, off in stood) < 1.5  # it stands there while it is asked
        true, scale = emulator.truth(TS), abs(known.scale)
        angles = sorted((ends.low_angle, ends.high_angle))
        play_and_noise = true["backlash"] + 4 * emulator.linearity + scale
        assert angles == pytest.approx([true["end_low"], true["end_high"]], abs=play_and_noise)
        middle = 0.5 * (ends.low + ends.high)
        assert abs(read_sensors(link).mean[0] - middle) < 0.15 * (ends.high - ends.low)
        # A share of the supply that moves the joint is above its break-away, and by no more than two steps.
        least = max(true["breakaway_up"], -true["breakaway_down"]) / 12.0
        assert least < max(found.moves_up, found.moves_down) < least + 0.2
