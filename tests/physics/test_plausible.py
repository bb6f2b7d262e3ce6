"""Logs whose numbers cannot be those of the joint are told at once, with what to set; what is set is then accepted."""

import numpy as np
import pytest

import twin
from sysid import Channel, ChannelMap, InputError
from sysid.channels.mapping import Clock
from twin.calibrate.calibration import calibrate
from twin.cli import main
from twin.compare.comparison import compare, twin_response
from twin.log import check_plausible

P = twin.Parameters()
LOG = twin.Experiment("thigh", "aprbs", duration=30.0, Ts=0.05, seed=4).run()
COLUMNS = (LOG.t, LOG.u, LOG.y)
FACTORS = {"ms": (1000.0, 1.0, 1.0), "mV": (1.0, 1000.0, 1.0), "deg": (1.0, 1.0, 180.0 / np.pi)}
SAYS = {
    "ms": r"sampled every 50 s, and at [\d.]+ V the thigh crosses its whole stroke in [\d.]+ s.*\[clock\]",
    "mV": r"the voltage of .* reaches [\d.]+ V and the supply has 12 V.*\[\[input\]\]",
    "deg": r"the angle of .* spans \d+\.?\d* rad and the thigh moves 1\.04 rad.*\[\[output\]\]",
}


def written(path, columns, header="time_s,voltage_V,angle_rad"):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def mapped(time="s", volts="V", angle="rad", u="voltage_V", y="angle_rad"):
    return ChannelMap(
        clock=Clock(column="time_s", unit=time),
        input=(Channel(column=u, unit=volts),),
        output=(Channel(column=y, unit=angle),),
    )


@pytest.mark.parametrize("unit", FACTORS)
def test_a_unit_that_is_not_what_the_header_says_is_told_and_the_mapping_settles_it(unit, tmp_path):
    path = written(tmp_path / "log.csv", [x * f for x, f in zip(COLUMNS, FACTORS[unit], strict=True)])
    wrong = twin.Log.load(path, joint="thigh")
    for work in (
        lambda: compare(wrong, "thigh"),
        lambda: calibrate([wrong], "thigh"),
        lambda: calibrate([LOG], "thigh", held_out=[wrong]),
        lambda: twin_response(wrong, "thigh"),
    ):
        with pytest.raises(InputError, match=SAYS[unit]):
            work()
    option = {"ms": "time", "mV": "volts", "deg": "angle"}[unit]
    right = twin.Log.load(path, mapped(**{option: unit}), "thigh")
    check_plausible(right, "thigh", P)
    assert right.Ts == LOG.Ts
    assert np.allclose(right.u, LOG.u, atol=1e-7)
    assert np.allclose(right.y, LOG.y, atol=1e-7)


def test_exchanged_columns_are_told_before_the_work(tmp_path, capsys):
    path = written(tmp_path / "log.csv", (LOG.t, LOG.y, LOG.u))
    assert main(["compare", str(path), "--joint", "thigh", "--out", str(tmp_path / "out")]) == 2
    assert "the columns may be exchanged" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()
    right = twin.Log.load(path, mapped(u="angle_rad", y="voltage_V"), "thigh")
    check_plausible(right, "thigh", P)
    assert np.allclose(right.u, LOG.u, atol=1e-7)


@pytest.mark.parametrize("joint", twin.JOINTS)
def test_what_the_twin_itself_records_is_plausible(joint):
    for excitation, Ts in (("sweep", 0.05), ("aprbs", 0.5), ("staircase", 0.01)):
        log = twin.Experiment(joint, excitation, duration=20.0, Ts=Ts, seed=1).run()
        check_plausible(log, joint, P)
        spiked = log.y.copy()
        spiked[log.N // 2] = 99.0  # one bad reading says nothing about the unit
        if log.N > 200:
            check_plausible(twin.Log(log.u, spiked, Ts, joint=joint), joint, P)
        check_plausible(twin.Log(0.0 * log.u, log.y, Ts, joint=joint), joint, P)


@pytest.mark.parametrize("factor", [1.0, 180.0 / np.pi])
def test_a_log_with_the_twins_names_and_an_angle_in_degrees_is_read(factor, tmp_path):
    unit = "rad" if factor == 1.0 else "deg"
    path = written(tmp_path / "log.csv", (LOG.t, LOG.u, factor * LOG.y), f"time_s,voltage_V,angle_{unit}")
    log = twin.Log.load(path, joint="thigh")
    assert np.allclose(log.y, LOG.y, atol=1e-7)
    assert np.allclose(log.u, LOG.u, atol=1e-7)
    assert (log.Ts, log.mode, log.u_unit) == (LOG.Ts, "voltage", "V")


def test_a_log_that_names_its_joint_is_held_to_its_columns(tmp_path):
    path = LOG.save(tmp_path / "log.csv")
    path.write_text(path.read_text(encoding="utf-8").replace("angle_rad", "angle_old"), encoding="utf-8")
    with pytest.raises(InputError, match="unknown column 'angle_rad'"):
        twin.Log.load(path)


def test_one_glitch_of_a_voltage_names_no_other_unit():
    u = LOG.u.copy()
    u[17] = 150.0
    check_plausible(twin.Log(u, LOG.y, LOG.Ts, joint="thigh"), "thigh", P)
