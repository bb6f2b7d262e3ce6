"""The emulator's rules are the firmware's: both see the same readings, and drive, cut and fail alike."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from twin.rig import wire
from twin.rig.avr import FIRMWARE
from twin.rig.board import Board, Joint
from twin.rig.calibration import longest_within

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed; install Debian's gcc")
FULL = 4092
SETUP = wire.Setup(0, 900, 3100, 3000, 1000, 100, 800, 40, wire.USED)
# The control loop's three calls for one joint, in the order of player.c.
LOOP = """
#include <string.h>
#include "safety.h"
static struct joint joint;
int begin(int low, int high, int strike, int duty, int slew, int stall, int motion, int place) {
    memset(&joint, 0, sizeof joint);
    joint.limits = (struct limits){.low = low, .high = high, .strike = strike, .duty = duty, .slew = slew,
                                   .stall = stall, .motion = motion, .used = true};
    joint.reading = place;
    for (int k = 0; k < SPEED_MS; k++) joint.past[k] = place;
    joint.smooth = joint.slow = 256L * place;
    joint_rest(&joint);
    return limits_complete(&joint.limits);
}
int fault(int place) {
    bool near = joint_read(&joint, place);
    return near ? joint_fault(&joint) : FAULT_SENSOR;
}
int cut(int level) { return joint_drive(&joint, level); }
int duty(void) { return joint.duty; }
"""


@pytest.fixture(scope="module")
def rules(tmp_path_factory):
    """safety.c on this computer."""
    folder = tmp_path_factory.mktemp("rules")
    (folder / "loop.c").write_text(LOOP)
    sources = [str(folder / "loop.c"), *(str(FIRMWARE / name) for name in ("safety.c", "wire.c"))]
    flags = ["-std=c99", "-DF_CPU=16000000UL", f"-I{FIRMWARE}", "-shared", "-fPIC", "-o", str(folder / "rules.so")]
    subprocess.run(["gcc", *flags, *sources], check=True)
    return ctypes.CDLL(str(folder / "rules.so"))


def of_firmware(rules, places, levels):
    """Duties, cuts, and tick and number of the fault, as the control loop calls it."""
    s, played = SETUP, []
    assert rules.begin(s.low, s.high, s.strike, s.duty, s.slew, s.stall, s.motion, int(places[0]))
    for k, (place, level) in enumerate(zip(places, levels, strict=True)):
        if reason := rules.fault(int(place)):
            return played, (k, reason)
        cut = rules.cut(int(level))
        played.append((rules.duty(), cut))
    return played, (len(places), 0)


def of_emulator(places, levels):
    joint, played = Joint(SETUP, FULL, float(places[0])), []
    for k, (place, level) in enumerate(zip(places, levels, strict=True)):
        if reason := joint.fault(float(place)):
            return played, (k, reason)
        cut = joint.next_duty(int(level))
        played.append((joint.duty, cut))
    return played, (len(places), 0)


def moved(levels, gain=1.0, start=2000.0, friction=150.0, lag=0.05):
    """Places of a joint with friction and a lag under levels, and a little noise [counts]."""
    rng, place, speed, places = np.random.default_rng(3), start, 0.0, []
    for level in levels:
        wanted = gain * np.sign(level) * max(abs(level) - friction, 0.0)
        speed += (wanted - speed) * 0.001 / lag
        place = float(np.clip(place + 0.001 * speed, 60.0, 4030.0))
        places.append(round(place + rng.normal(0.0, 0.7)))
    return np.array(places)


def square(level, half, n=4000):
    return np.where(np.arange(n) // half % 2 == 0, level, -level)


UNPLUGGED, JUMPED, FAST, STUCK = 5, 3, 6, 4
CASES = {
    "to and fro": (square(600, 700), {}, None),
    "into its high limit, and back": (square(900, 1900), {}, None),
    "pulses below friction": (np.where(np.arange(4000) % 800 < 600, 260, 0), {"friction": 300.0}, wire.STALL),
    "a small duty may rest": (np.full(4000, 140), {}, None),
    "against its drive": (square(600, 700), {"gain": -1.0}, wire.DIRECTION),
    "too fast": (square(1000, 700), {"gain": 5.0}, wire.STRIKE),
    "stuck": (np.full(4000, 600), {"gain": 0.0}, wire.STALL),
}


@needs_gcc
@pytest.mark.parametrize("case", CASES)
def test_the_emulator_judges_as_the_firmware(rules, case):
    levels, joint, expected = CASES[case]
    places = moved(levels, **joint)
    played, (tick, reason) = of_firmware(rules, places, levels)
    mine, (my_tick, my_reason) = of_emulator(places, levels)
    assert my_reason == reason
    assert expected is None or reason == expected
    assert expected is not None or reason == 0
    assert my_tick == pytest.approx(tick, abs=4)  # the firmware counts in whole numbers
    n = min(len(played), len(mine))
    assert mine[:n] == played[:n]


@needs_gcc
@pytest.mark.parametrize("steady", [400, 15])
@pytest.mark.parametrize("speed", [0.8, 1.6, 2.4])
def test_a_joint_that_coasts_on_is_against_its_drive_at_the_same_tick_for_both(rules, speed, steady):
    """It goes at `speed` [counts/ms], for long or for just 15 ms, its drive turns, and it never slows down: for how
    long that is coasting depends on the speed that the lags of 4 and 16 ms make of its places."""
    places = np.round(np.concatenate([np.full(100, 1500.0), 1500.0 + speed * np.arange(1, steady + 400)]))
    levels = np.where(np.arange(len(places)) < 100 + steady, 600, -600)
    played, (tick, reason) = of_firmware(rules, places, levels)
    mine, (my_tick, my_reason) = of_emulator(places, levels)
    assert reason == my_reason == wire.DIRECTION
    assert (my_tick, mine) == (tick, played)
    if steady == 400:  # the pace is kept for d, then decays with q, until the joint is the motion ahead
        d, q, t = SETUP.stall // 60, 125.0, np.arange(400.0)
        ahead = speed * (t - d - q * (1.0 - np.exp(-(t - d) / q)))
        assert tick - 500 == pytest.approx(np.argmax((ahead >= SETUP.motion) & (t > d)), abs=12)


@needs_gcc
@pytest.mark.parametrize("place", [0, 30, 4080, 3000])
def test_a_sensor_that_fails_is_seen_at_once_by_both(rules, place):
    levels = np.full(200, 300)
    places = moved(levels)
    places[100:] = place
    fault = of_firmware(rules, places, levels)[1]
    assert fault == of_emulator(places, levels)[1] == (100, wire.NO_SENSOR)


@needs_gcc
def test_random_courses_are_judged_alike(rules):
    rng = np.random.default_rng(5)
    reasons = []
    for _ in range(60):
        levels = np.repeat(rng.integers(-1000, 1001, 20), 200)
        places = moved(levels, rng.uniform(-0.3, 2.5), rng.uniform(1000, 3000), rng.uniform(50, 400), 0.04)
        played, (tick, reason) = of_firmware(rules, places, levels)
        mine, (my_tick, my_reason) = of_emulator(places, levels)
        assert (my_reason, my_tick) == (reason, pytest.approx(tick, abs=6))
        n = min(len(played), len(mine))
        assert mine[:n] == played[:n]
        reasons.append(reason)
    assert {0, wire.STALL, wire.DIRECTION} <= set(reasons)


def test_the_longest_time_within_a_width_is_that_of_every_stretch_tried():
    rng = np.random.default_rng(2)
    for _ in range(30):
        places, counted = np.cumsum(rng.normal(size=40)), rng.random(40) < 0.7
        tried = [counted[i:j].sum() for i in range(40) for j in range(i + 1, 41) if np.ptp(places[i:j]) < 2.0]
        assert longest_within(places, counted, 2.0) == max(tried)


class Still:
    """A joint that stands at mid range and a supply that is there."""

    full = FULL

    def position(self, joint):
        return 2000.0

    def reading(self, joint):
        return 2000

    def supply(self):
        return 1600

    def step(self, duties):
        self.duties = duties

    def switch_off(self):
        self.duties = [0.0] * 3


def said(board, *messages):
    """The reasons with which a board answers."""
    for k, message in enumerate(messages):
        board.answer(k, message)
    done = [m.reason for m in board.outbox if isinstance(m, wire.Done)]
    board.outbox.clear()
    return done


def test_what_the_page_refuses_is_refused_with_its_reason():
    row = tuple(range(20))
    few = wire.Levels(0, 20, row)
    for messages, reason in (
        ([wire.Start()], wire.STATE),
        ([few], wire.SETUP),
        ([wire.Setup(3, *[0] * 8)], wire.VALUE),
        ([wire.Setup(0, 900, 800, 1, 1, 1, 1, 1, wire.USED)], wire.VALUE),
        ([SETUP, wire.Levels(5, 20, row)], wire.GAP),
        ([SETUP, wire.Levels(0, 1, (1024,))], wire.VALUE),
        ([SETUP, few, wire.Arm(41, 20, 1)], wire.VALUE),
        ([SETUP, few, wire.Arm(40, 21, 1)], wire.FEW),
        ([SETUP, few, wire.Arm(40, 20, 1), SETUP], wire.STATE),
        ([SETUP, few, wire.Arm(40, 20, 1), wire.Start(), wire.Arm(40, 20, 1)], wire.STATE),
    ):
        answers = said(Board(Still()), *messages)
        assert answers == [0] * (len(messages) - 1) + [reason], messages


def test_the_ring_holds_256_levels_and_a_repetition_takes_no_room():
    board = Board(Still())
    rows = [wire.Levels(k, 16, (0,) * 16) for k in range(0, 256, 16)]
    assert said(board, SETUP, *rows, rows[-1], wire.Levels(256, 1, (0,))) == [0] * 18 + [wire.ROOM]


def test_a_run_without_its_next_level_is_starved():
    board = Board(Still())
    assert said(board, SETUP, wire.Levels(0, 10, (100,) * 10), wire.Arm(20, 10, 1), wire.Start()) == [0, 0, 0, 0]
    board._arm = wire.Arm(20, 11, 1)  # one more sample than there are levels
    for _ in range(200):
        if board.state == wire.RUNNING:
            board.tick()
    assert board.state == wire.FAILED
    assert [m.reason for m in board.outbox if isinstance(m, wire.Fault)] == [wire.STARVED] * 3
    assert len([m for m in board.outbox if isinstance(m, wire.Sample)]) == 10
    assert board.plant.duties == [0.0] * 3
