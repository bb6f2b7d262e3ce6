"""The XL330 logs through the same path as every log: irregular stamps, a signed word, a duty times a supply."""

import json

import numpy as np
import pytest

import twin
from sysid import Channel, ChannelMap, InputError, read_signals
from sysid.channels.mapping import Clock, Range
from sysid.channels.reading import read_signals as read

FULL_DUTY = 885.0


def entries(path) -> dict[str, np.ndarray]:
    rows = json.loads(path.read_text())["entries"]
    return {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]}


@pytest.fixture
def logs(records):
    found = sorted((records / "bam_xl330").glob("*.json"))
    assert len(found) == 16
    return found


def test_guessed_as_a_servo_whose_units_are_told_to_be_missing(logs):
    for path in logs:
        made = read_signals(path)
        raw = entries(path)
        assert (made.input[0].column, made.output[0].column) == ("goal_position", "position")
        assert made.mapping.clock.unit == "s"
        steps = np.diff(raw["timestamp"])
        assert made.Ts == pytest.approx(np.median(steps), rel=5e-3)
        assert 180 < 1 / made.Ts < 290
        at = raw["timestamp"][0] + made.t
        np.testing.assert_allclose(made.output[0].values, np.interp(at, raw["timestamp"], raw["position"]), atol=1e-9)
        assert made.counts["interpolated"] == made.N
        assert set(made.counts) <= {"interpolated", "lost", "filled samples"}
        with pytest.raises(InputError, match="no known unit"):
            twin.Log.load(path)


def test_a_mapping_makes_volts_and_stops_with_the_torque(logs):
    volts = Channel(column="load", signed=16, times="input_volts", scale=1 / FULL_DUTY, unit="V", between="line")
    mapping = ChannelMap(
        clock=Clock(column="timestamp", Ts=0.005),
        input=(volts,),
        output=(Channel(column="position", unit="rad"),),
        range=Range(active="torque_enable"),
    )
    for path in logs:
        log, raw = twin.Log.load(path, mapping), entries(path)
        on = raw["torque_enable"] != 0
        n = len(on) if on.all() else int(on.argmin())
        duty = np.where(raw["load"] > 32767, raw["load"] - 65536, raw["load"])
        assert (log.Ts, log.mode) == (0.005, "voltage")
        assert abs(log.N * log.Ts - raw["timestamp"][n - 1]) < 0.01
        at = raw["timestamp"][0] + log.t
        seen = slice(0, n)
        expected = np.interp(at, raw["timestamp"][seen], (duty * raw["input_volts"] / FULL_DUTY)[seen])
        np.testing.assert_allclose(log.u, expected, atol=1e-9)
        np.testing.assert_allclose(log.y, np.interp(at, raw["timestamp"][seen], raw["position"][seen]), atol=1e-9)
        assert log.meta["file"]["motor"] == "xl330"


def test_goal_to_position_with_units_is_a_servo(logs):
    mapping = ChannelMap(
        clock=Clock(column="timestamp"),
        input=(Channel(column="goal_position", unit="rad"),),
        output=(Channel(column="position", unit="rad"),),
    )
    log = twin.Log.load(logs[0], mapping)
    assert (log.mode, log.u_unit) == ("servo", "rad")
    assert read(logs[0], mapping).N == log.N
