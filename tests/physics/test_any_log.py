"""`twin.Log.load` of logs that other programs wrote: the same voltage and angle, or the line of the mapping to set."""

from pathlib import Path

import numpy as np
import pytest

import twin
from sysid import Channel, ChannelMap, InputError
from sysid.channels.mapping import Adc, Clock, Repair
from sysid.formats import WRITTEN


def bench(joint: str = "thigh", **options) -> twin.Log:
    """A short experiment."""
    return twin.Experiment(joint, "aprbs", duration=6.0, Ts=0.02, seed=4, **options).run()


def rig(path: Path, log: twin.Log, lost: tuple[int, ...] = ()) -> Path:
    """The log as a rig's board prints it: milliseconds in 16 bits, PWM of 12 V in 255 steps, codes of 10 bits."""
    k = np.setdiff1d(np.arange(log.N), lost)
    millis = (65_000 + 20 * k) % 2**16
    pwm = np.rint(log.u * 255 / 12)[k]
    adc = np.rint((log.y / 4.712 + 0.5) * 1023)[k]
    rows = np.column_stack([millis, adc, pwm]).astype(int)
    np.savetxt(path, rows, fmt="%d", delimiter=";", header="millis;adc;pwm", comments="")
    return path


MAP = ChannelMap(
    clock=Clock(column="millis", unit="ms", period=65536),
    input=(Channel(column="pwm", scale=12 / 255, unit="V"),),
    output=(Channel(column="adc", unit="rad", adc=Adc(bits=10, value=(-2.356, 2.356))),),
)


def test_a_capture_of_counts_is_the_log_to_the_last_digit(tmp_path):
    log = bench()
    back = twin.Log.load(rig(tmp_path / "rig.csv", log, lost=(50, 120, 121)), MAP, "thigh")
    assert (back.joint, back.mode, back.N, back.Ts) == ("thigh", "voltage", log.N, 0.02)
    kept = np.setdiff1d(np.arange(log.N), [50, 120, 121])
    assert np.abs(back.y - log.y)[kept].max() <= 0.5 * 4.712 / 1023 + 1e-12
    assert np.abs(back.u - log.u)[kept].max() <= 0.5 * 12 / 255 + 1e-12
    assert back.meta["filled"] == [50, 120, 121]
    assert back.meta["repairs"] == {"wraps": 1, "lost": 3, "filled samples": 3}
    assert back.meta["channels"]["clock"] == {"column": "millis", "unit": "ms", "period": 65536.0}
    data = back.io()
    assert np.flatnonzero(data.missing[:, 0]).tolist() == [50, 120, 121]
    again = twin.Log.load(back.save(tmp_path / "again.csv"))
    assert (again.joint, again.meta["filled"]) == ("thigh", [50, 120, 121])
    np.testing.assert_array_equal(again.y, back.y)


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize("options", [{}, {"joint": "leg", "mode": "servo"}], ids=["voltage", "leg in servo mode"])
def test_what_was_saved_comes_back_whole(suffix, options, tmp_path):
    log = bench(**options)
    back = twin.Log.load(log.save(tmp_path / f"log{suffix}"))
    assert (back.joint, back.mode, back.Ts, back.u_unit) == (log.joint, log.mode, log.Ts, "V")
    for name in ("u", "y", "y_true"):
        np.testing.assert_array_equal(getattr(back, name), getattr(log, name))
    assert {name: back.meta[name] for name in ("seed", "excitation")} == {"seed": 4, "excitation": "aprbs"}
    if log.joint == "leg":
        shank = twin.Log.load(tmp_path / f"log{suffix}", joint="shank")
        assert shank.joint == "shank"
        np.testing.assert_array_equal(shank.u, log.u[:, 2])
        np.testing.assert_array_equal(shank.io().y, log.io("shank").y)


def test_a_servo_that_takes_angles_stays_one(tmp_path):
    t = 0.005 * np.arange(400)
    goal, position = np.round(np.sin(2 * t), 6), np.round(0.9 * np.sin(2 * t - 0.1), 6)
    rows = np.column_stack([t, np.rad2deg(goal), np.rad2deg(position)])
    np.savetxt(
        tmp_path / "servo.csv", rows, delimiter=",", header="t,goal [deg],position [deg]", comments="", fmt="%.9f"
    )
    log = twin.Log.load(tmp_path / "servo.csv")
    assert (log.mode, log.u_unit, log.joint) == ("servo", "rad", "")
    np.testing.assert_allclose(log.u, goal, atol=1e-9)
    np.testing.assert_allclose(log.y, position, atol=1e-9)
    assert (log.io().u_name, log.io().u_unit, log.io().y_unit) == ("reference", "rad", "rad")
    again = twin.Log.load(log.save(tmp_path / "again.parquet"))
    assert (again.mode, again.u_unit) == ("servo", "rad")
    np.testing.assert_array_equal(again.u, log.u)


def test_a_reference_in_volts_is_a_servos_and_a_commanded_voltage_is_none(tmp_path):
    t = 0.01 * np.arange(100)
    for name, mode in (("goal_V", "servo"), ("commanded_voltage_V", "voltage")):
        rows = np.column_stack([t, np.sign(np.sin(3 * t)), np.sin(t)])
        np.savetxt(tmp_path / "rig.csv", rows, delimiter=",", header=f"t,{name},pos_deg", comments="", fmt="%.9f")
        log = twin.Log.load(tmp_path / "rig.csv")
        assert (log.mode, log.u_unit) == (mode, "V")
        np.testing.assert_allclose(log.y, np.deg2rad(np.sin(t)), atol=1e-9)


@pytest.mark.parametrize(
    ("header", "said"),
    [
        (
            "t,u_V,angle",
            r"the output 'angle' is in no known unit, .* set unit = \"deg\" or \"rad\".* of \[\[output\]\]",
        ),
        ("t,u_V,adc", r"the output 'adc' is in counts, and the twin needs an angle"),
        ("t,u_V,height [mm]", r"the output 'height \[mm\]' is in m, and the twin needs an angle"),
        ("t,pwm,angle_rad", r"the input 'pwm' is in no known unit, .* set scale and unit = \"V\" of \[\[input\]\]"),
        ("t,cmd [mA],angle_rad", r"the input 'cmd \[mA\]' is in A, and the twin needs a voltage"),
    ],
)
def test_channels_in_other_units_are_refused_with_the_line_to_set(header, said, tmp_path):
    t = 0.01 * np.arange(100)
    rows = np.column_stack([t, np.sign(np.sin(3 * t)), np.sin(t)])
    np.savetxt(tmp_path / "rig.csv", rows, delimiter=",", header=header, comments="", fmt="%.6f")
    with pytest.raises(InputError, match=said):
        twin.Log.load(tmp_path / "rig.csv")


def test_a_joint_that_is_not_the_logs_is_refused(tmp_path):
    path = bench().save(tmp_path / "log.csv")
    with pytest.raises(InputError, match="the log is of the thigh, not the shank"):
        twin.Log.load(path, joint="shank")
    with pytest.raises(InputError, match="unknown joint 'knee'"):
        twin.Log.load(path, joint="knee")
    twice = (*MAP.input, Channel(column="again", unit="V"))
    two = MAP.model_copy(update={"input": twice})
    with pytest.raises(InputError, match=r"the mapping has 2 input\(s\) and 1 output\(s\)"):
        twin.Log.load(with_another_column(rig(tmp_path / "rig.csv", bench())), two)


def with_another_column(path):
    first, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"{first};again", *(f"{row};{k % 5}" for k, row in enumerate(rows))]) + "\n")
    return path


def test_a_long_gap_is_refused_with_the_row_unless_the_mapping_allows_it(tmp_path):
    path = rig(tmp_path / "rig.csv", bench(), lost=tuple(range(100, 110)))
    with pytest.raises(
        InputError,
        match=r"row 102, column 'millis': found a step of 0.22 s .* piece, 190 of 290 rows, with --range 2.2:5.98",
    ):
        twin.Log.load(path, MAP)
    allowed = MAP.model_copy(update={"repair": Repair(longest_gap=10)})
    assert twin.Log.load(path, allowed).meta["filled"] == list(range(100, 110))
