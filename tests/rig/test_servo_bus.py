"""Servos on an emulated bus: their packets against the makers' libraries, values found, faults, and sentences."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from often import by_day

pytest.importorskip("dynamixel_sdk", reason="servo buses need dynamixel-sdk: pip install 'qpal[dynamixel]'")
pytest.importorskip("scservo_sdk", reason="servo buses need ftservo-python-sdk: pip install 'qpal[feetech]'")

import dynamixel_sdk
import scservo_sdk

import sysid
from sysid.base.errors import InputError
from sysid.blocks import ServoMotor
from sysid.structures import ServoJoint, servo_joint
from sysid.workflow.record import read_record
from sysid.workflow.servo import with_servo
from twin.cli import main
from twin.log import Log
from twin.rig.bus.device import Device, drawn
from twin.rig.bus.emulator import Emulator
from twin.rig.bus.packets import crc16
from twin.rig.bus.recording import log_of, save
from twin.rig.bus.registers import DYNAMIXEL, FAMILIES, FEETECH, MIDDLE, TICK
from twin.rig.bus.run import check_goals, play
from twin.rig.bus.servo import wired
from twin.rig.link import Lost
from twin.rig.run import Input

TS = 0.02
BOTH = pytest.mark.parametrize("family", list(FAMILIES.values()), ids=list(FAMILIES))


def steps(N=1000, seed=0, span=0.7):
    return np.repeat(np.random.default_rng(seed).uniform(-span, span, -(-N // 25)), 25)[:N]


def quiet(sentence):
    """Nobody listens."""


def played(emulator, u, hook=None, **changes):
    """Wire and run: recording, log, the servo's file; `hook` is called with the share that is done."""
    with emulator.bus() as bus:
        servo = wired(bus, 1, "thigh", quiet)[0].model_copy(update=changes)
        goals = check_goals(Input(u, TS), servo)
        recording, known = play(bus, servo, goals, TS, hook or (lambda share: None))
        return recording, log_of(recording, servo, known), servo


# Packets.


def test_packets_are_those_of_the_makers_pages():
    """Ping of ID 1: e-manual, protocol 2.0, "Ping", and Feetech's protocol page."""
    assert crc16(bytes.fromhex("FFFFFD00010300 01".replace(" ", ""))).to_bytes(2, "little") == bytes.fromhex("194E")
    assert FEETECH.registers["position"].number(bytes([5, 0x80])) == -5  # bit 15 is the sign
    assert DYNAMIXEL.registers["position"].number(b"\xfb\xff\xff\xff") == -5


@BOTH
def test_the_makers_library_talks_to_the_stand_in_over_a_pseudo_terminal(family):
    """Its own port and its own packets, nothing of the rig's: ping, read, write, sync write and sync read."""
    devices = [Device(family, n, drawn(family.name, n), n) for n in (1, 7)]
    feetech = family is FEETECH
    sdk = scservo_sdk if feetech else dynamixel_sdk
    with Emulator(family, devices=devices, speed=1.0) as emulator:
        port = sdk.PortHandler(emulator.port)
        assert port.openPort()
        packets = sdk.sms_sts(port) if feetech else sdk.Protocol2PacketHandler()
        first = () if feetech else (port,)
        group = (packets,) if feetech else (port, packets)
        # The library reads in a loop without a pause, which may leave the thread of the stand-in without its turn.
        answers = (packets.ping(*first, 7)[:2] for _ in range(10))
        assert next((model for model, how in answers if how == sdk.COMM_SUCCESS), None) == (777 if feetech else 1200)
        assert packets.ping(*first, 3)[1] == sdk.COMM_RX_TIMEOUT
        goal, p = family.registers["goal"], family.registers["p"]
        write = sdk.GroupSyncWrite(*group, goal.address, goal.size)
        for n in (1, 7):
            assert write.addParam(n, list(goal.data(2000 + n)))
        assert write.txPacket() == sdk.COMM_SUCCESS
        read = sdk.GroupSyncRead(*group, goal.address, goal.size)
        assert read.addParam(1)
        assert read.addParam(7)
        assert any(read.txRxPacket() == sdk.COMM_SUCCESS for _ in range(10))
        assert [read.getData(n, goal.address, goal.size) for n in (1, 7)] == [2001, 2007]
        # A D register of FF FF FD would be stuffed; three bytes of the table that hold it travel whole.
        stuffed = [0xFF, 0xFF, 0xFD, 5]
        assert any(packets.writeTxRx(*first, 1, 220, 4, stuffed)[0] == sdk.COMM_SUCCESS for _ in range(10))
        assert any(bytes(packets.readTxRx(*first, 1, 220, 4)[0]) == b"\xff\xff\xfd\x05" for _ in range(10))
        given = list(p.data(90))
        assert any(packets.writeTxRx(*first, 7, p.address, p.size, given)[0] == sdk.COMM_SUCCESS for _ in range(10))
        assert [d.get("p") for d in devices] == [32 if feetech else 400, 90]
        port.closePort()


# Ground truth.


@pytest.mark.parametrize("seed", by_day([1, 2], 1))
@BOTH
def test_wire_run_and_identify_find_the_hidden_values(family, seed, tmp_path):
    hidden = drawn(family.name, seed)
    hidden = replace(hidden, pendulum=hidden.pendulum.replace(load_friction=0.0))
    device = Device(family, 1, hidden, seed)
    with Emulator(family, seed, [device], garbled=0.01, lost=0.001, late=0.002) as emulator:
        recording, log, _ = played(emulator, steps(1500, seed))
        true = emulator.truth()
    data = Log.load(save(log, recording, tmp_path / "log.csv")).io()
    recipe, _ = with_servo(ServoJoint(), [read_record(tmp_path / "log.csv", missing="mark")])
    assert recipe.loop == ("pd" if family is FEETECH else "p")
    assert recipe.kp == pytest.approx(true["kp"], rel=1e-12)
    chain = servo_joint(ServoMotor(load=0, periodic=1, stops=False, loop=recipe.loop), play=False, kp=recipe.kp)
    fit = sysid.fit(chain, data, search="lm", starts=2)
    found = dict(zip(fit.model.names, fit.theta, strict=True))
    assert found["motor.gain"] / TS == pytest.approx(true["speed_full_drive"], rel=0.02)
    assert found["motor.lag"] * TS == pytest.approx(true["time_constant"], rel=0.05, abs=0.002)
    assert np.hypot(found["motor.sine1"], found["motor.cosine1"]) == pytest.approx(true["pull"], rel=0.03)
    assert 0.5 * (found["motor.rise"] + found["motor.fall"]) == pytest.approx(true["coulomb"], rel=0.15, abs=0.002)
    if family is FEETECH:
        assert found["motor.kd"] * TS == pytest.approx(true["kd"], rel=0.25)
    assert fit.fit_percent(data) > 98.5


@BOTH
def test_what_is_lost_or_late_is_missing_and_the_rest_is_what_the_servo_had(family, monkeypatch):
    """Every position and goal of the log beside those that the servo put into its registers for an answer."""
    told = {}
    measure = Device._measure

    def recorded(device):
        measure(device)
        told[round(device.now, 6)] = device.get("position"), device.get("goal")

    moments, wait = [], Emulator.wait_until
    monkeypatch.setattr(Emulator, "wait_until", lambda self, moment: moments.append(moment) or wait(self, moment))
    monkeypatch.setattr(Device, "_measure", recorded)
    with Emulator(family, 3, garbled=0.02, lost=0.02, late=0.01) as emulator:
        recording, log, servo = played(emulator, steps(600))
    missing = np.isnan(log.y)
    assert 20 < missing.sum() < 200
    assert log.meta["filled"] == np.flatnonzero(missing).tolist()
    assert np.all(missing[recording.late])
    assert len(recording.late) > 2
    start = moments[-600]
    times = np.array(sorted(told))
    for k in np.flatnonzero(~missing):
        near = times[np.abs(times - start - recording.read[k]) < 3e-3]
        pairs = {told[t] for t in near}
        assert (round(log.y[k] / TICK) + MIDDLE, round(log.u[k] / TICK) + MIDDLE) in pairs, k
    assert recording.garbled > 5
    assert recording.silent > 5
    assert recording.other_goals > 0  # goals that the servo never got: the log has the former ones
    assert recording.other_goals == log.meta["rig"]["goals_that_did_not_arrive"]
    assert servo.reversed is False


def test_a_run_depends_on_the_seed_alone():
    logs = []
    for _ in range(2):
        with Emulator(DYNAMIXEL, 5, garbled=0.01, lost=0.01) as emulator:
            logs.append(played(emulator, steps(200))[1])
    assert np.array_equal(logs[0].y, logs[1].y, equal_nan=True)


def test_in_real_time_the_log_tells_the_true_jitter():
    with Emulator(DYNAMIXEL, 1, speed=1.0) as emulator:
        recording, log, _ = played(emulator, steps(60))
    assert recording.reason == ""
    grid = np.arange(60) * TS
    assert np.nanmax(np.abs(recording.sent - grid)) < 0.5 * TS
    assert log.meta["rig"]["jitter_ms"] == pytest.approx(1e3 * np.nanstd(recording.read - grid), abs=1e-3)
    assert recording.off is not None


# Safety.


@BOTH
def test_limits_and_slew_hold_whatever_is_asked(family):
    goals, write = [], Device._put

    def kept(device, address, data):
        if address == family.registers["goal"].address and device.get("torque"):
            goals.append(family.registers["goal"].number(data))
        return write(device, address, data)

    with pytest.MonkeyPatch.context() as patch, Emulator(family, 1) as emulator:
        patch.setattr(Device, "_put", kept)
        u = np.where(np.arange(200) // 50 % 2 == 0, 0.6, -0.6)
        recording, log, servo = played(emulator, u, slew=5.0)
    assert np.abs(np.diff(goals)).max() * TICK <= 5.0 * TS + 2 * TICK
    assert min(goals) >= servo.position(servo.soft_low)
    assert max(goals) <= servo.position(servo.soft_high)
    assert np.abs(log.u).max() == pytest.approx(0.6, abs=TICK)
    assert recording.reason == ""
    assert not emulator.device.torque_log[-1][1]
    assert recording.off is not None
    assert recording.off < 0.01


def broken(family, trouble, **changes):
    """A run in which something breaks at 40 %: the recording, when it broke, and when the torque went off [s]."""
    with Emulator(family, 1) as emulator:
        when = []

        def hook(share):
            if share >= 0.4 and not when:
                when.append(emulator.now())
                trouble(emulator)

        recording, *_ = played(emulator, steps(400), hook, **changes)
        emulator.wait_until(emulator.now() + 1.0)
        moment, on = emulator.device.torque_log[-1]
        return recording, moment - (when or [0.0])[0], on, emulator.device


def stop(emulator):
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("trouble", "limit", "said"),
    [
        (lambda e: e.device.break_down("hot"), 0.05, "the servo has 85 C, and the limit is 65 C"),
        (lambda e: e.device.break_down("overload"), 0.05, "the servo reports an error of load"),
        (stop, 0.02, "it was stopped by hand"),
    ],
    ids=["hot", "overload", "ctrl-c"],
)
@BOTH
def test_the_torque_goes_off_in_time(family, trouble, limit, said):
    recording, seconds, on, _ = broken(family, trouble)
    assert said in recording.reason
    assert not on
    assert seconds < limit
    assert 150 < len(recording.goals) < 200
    assert recording.off is not None


@BOTH
def test_a_joint_that_is_held_and_too_much_current_turn_the_torque_off(family):
    recording, _, on, _ = broken(family, lambda e: e.device.break_down("stuck"), stall=0.3)
    if recording.reason:  # a P servo near its goal does not drive at full
        assert "stall" in recording.reason
        assert not on
    recording, _, on, _ = broken(family, lambda e: None, largest_current=0.02)
    assert "the limit is 0.02 A" in recording.reason
    assert not on


@BOTH
def test_a_lost_line_ends_the_run_and_the_watchdog_of_a_dynamixel_stops_it(family):
    recording, _, on, device = broken(family, lambda e: e.pull())
    assert recording.reason == "the servo does not answer any more"
    assert recording.off is None  # nobody confirmed it
    assert on  # what no line reaches keeps its torque; a Dynamixel stops where it is
    if family is DYNAMIXEL:
        assert device.get("watchdog") == -1
        at = device.angle
        for _ in range(10):
            device.tick()
        assert device.angle == pytest.approx(at, abs=0.01)
        assert device.get("goal") != recording.goals[-1]


def test_nothing_moves_where_the_servo_does_not_rest(monkeypatch):
    with Emulator(DYNAMIXEL, 1) as emulator, emulator.bus() as bus:
        servo, _ = wired(bus, 1, "thigh", quiet)
        emulator.device._data.qvel[:] = 3.0
        with pytest.raises(InputError, match="wait until it rests"):
            play(bus, servo, check_goals(Input(steps(50), TS), servo), TS)
        assert emulator.device.torque_log == [(0.0, False)]


# Sentences.


def test_who_does_not_answer_or_is_another_gets_a_sentence():
    with Emulator(DYNAMIXEL, 1) as emulator, emulator.bus() as bus:
        with pytest.raises(InputError, match="servo 9 does not answer; check its number, its supply"):
            wired(bus, 9, "thigh", quiet)
        servo, _ = wired(bus, 1, "thigh", quiet)
        emulator.device.set("model", 1060)
        with pytest.raises(InputError, match="is a XL430-W250, and the rig's file is of a XL330-M288"):
            play(bus, servo, np.full(20, MIDDLE), TS)
        emulator.device.set("model", 4444)
        with pytest.raises(InputError, match="has the model number 4444; the rig knows XL330-M288 \\(1200\\)"):
            wired(bus, 1, "thigh", quiet)
        emulator.device.set("model", 1200)
        emulator.device.set("mode", 1)
        with pytest.raises(InputError, match="is in mode 1, and the rig plays goals in position mode \\(3\\)"):
            wired(bus, 1, "thigh", quiet)


@BOTH
def test_two_servos_with_one_number_get_a_sentence(family):
    devices = [Device(family, 1, drawn(family.name, n), n) for n in (1, 2)]
    with Emulator(family, devices=devices) as emulator, emulator.bus() as bus:
        with pytest.raises(InputError, match="garbled; perhaps two servos have this number"):
            wired(bus, 1, "thigh", quiet)
        assert bus.scan() == {1: None}


def test_a_missing_library_names_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "dynamixel_sdk", None)
    with pytest.raises(
        InputError, match=r"need dynamixel-sdk, which is not installed: pip install 'qpal\[dynamixel\]'"
    ):
        Emulator(DYNAMIXEL, 1).bus()
    monkeypatch.delattr(scservo_sdk, "sms_sts")
    with pytest.raises(InputError, match="is that of another package"):
        Emulator(FEETECH, 1).bus()


def test_a_port_that_is_held_or_gone_gets_a_sentence():
    with Emulator(DYNAMIXEL, 1, speed=1.0) as emulator:
        with emulator.bus(), pytest.raises(InputError, match="another program holds this port"):
            emulator.bus()
        with emulator.bus() as bus:
            emulator.close()
            with pytest.raises(Lost, match="the connection is lost"):
                bus.model(1)


def test_a_bus_that_is_too_slow_for_the_goals_is_told_before_anything_moves():
    with Emulator(DYNAMIXEL, 1) as emulator, emulator.bus() as bus:
        servo, _ = wired(bus, 1, "thigh", quiet)
        with pytest.raises(InputError, match=r"a goal and a reading take .* ms and a sample 1 ms; give samples of"):
            play(bus, servo, np.full(50, servo.position(0.2)), 0.001)
        assert emulator.device.torque_log == [(0.0, False)]


def test_the_gains_of_a_header_give_way_to_given_ones_and_logs_of_other_gains_are_refused(tmp_path):
    records = []
    for name, kp in (("a", 400), ("b", 800)):
        with Emulator(DYNAMIXEL, 1) as emulator:
            emulator.device.set("p", kp)
            recording, log, _ = played(emulator, steps(60))
        records.append(read_record(save(log, recording, tmp_path / f"{name}.csv")))
    given = ServoJoint(kp=2.0)
    assert with_servo(given, records[:1])[0] == given
    assert any(
        "the header names the servo's loop: P, kp 1.151" in r for r in with_servo(ServoJoint(), records[:1])[1].remarks
    )
    with pytest.raises(InputError, match="recorded with other gains of the servo"):
        with_servo(ServoJoint(), records)


# The verbs.


@BOTH
def test_the_verbs_go_from_a_bus_to_a_log(family, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rig = ("--emulate", family.name, "--seed", "2")
    u = np.rad2deg(steps(200, span=0.5))
    np.savetxt(
        "goals.csv", np.column_stack([np.arange(200) * TS, u]), delimiter=",", header="time [s],goal [deg]", comments=""
    )
    if family is DYNAMIXEL:  # a Feetech bus is asked number by number
        assert main(["rig", "find", *rig]) == 0
        assert "ID 1: XL330-M288" in capsys.readouterr().out
    assert main(["rig", "wire", "thigh", *rig]) == 0
    assert main(["rig", "run", "goals.csv", *rig, "--yes", "--log", "log.csv"]) == 0
    out = capsys.readouterr().out
    assert "jitter" in out
    assert "Hidden in the emulated servo: " in out
    assert "Next: qpal identify log.csv --structure servo_joint" in out
    assert Log.load("log.csv").mode == "servo"
    assert main(["rig", "zero", "--emulate", family.name]) == 2
    assert "a servo knows its angle" in capsys.readouterr().err
    np.savetxt(
        "far.csv",
        np.column_stack([np.arange(50) * TS, np.full(50, 100.0)]),
        delimiter=",",
        header="time [s],goal [deg]",
        comments="",
    )
    assert main(["rig", "run", "far.csv", *rig, "--yes", "--log", "far-log.csv"]) == 2
    assert "has the goal 100 deg at 0 s, and the soft limits are" in capsys.readouterr().err
