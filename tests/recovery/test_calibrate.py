"""Calibration of the leg: known parameters come back, and what a log cannot tell is said."""

import numpy as np
import pytest
import standin
from often import by_day
from standin import LACKS, StandIn

import twin
from sysid.base.errors import InputError
from sysid.joint.values import JointValue
from twin.calibrate import advice
from twin.calibrate.advice import what_to_record
from twin.calibrate.calibration import calibrate, rows_to_free
from twin.calibrate.leg import ROWS, own_rows, usual
from twin.calibrate.start import from_joint, mapped_rows
from twin.cli import main
from twin.hardware.linkage import end_angles, linkage
from twin.parameter_file import read
from twin.truth import arm, closed_form, linear_bench, load

# Off nominal by as much as a catalogue part may be; found values may be off by the tolerance.
CASES = {
    "shoulder": {"upper": (0.65, 0.003), "no_load_speed": (0.85, 0.01), "coulomb": (1.2, 0.05)},
    "thigh": {"retracted_length": (0.2045, 1e-4), "no_load_speed": (0.018, 2e-4), "coulomb": (20.0, 1.0)},
    "shank": {"stroke": (0.068, 2e-4), "no_load_speed": (0.011, 2e-4), "coulomb": (33.0, 1.0)},
}


def hidden(joint):
    return twin.Parameters({f"{joint}.{name}": value for name, (value, _) in CASES[joint].items()})


def record(joint, seed=5, excitation="sweep", duration=20.0):
    half = {"shoulder": 2.0, "thigh": 8.0, "shank": 8.0}[joint]
    options = {"half_period": half, "first": 0.6, "shrink": 0.3} if excitation == "sweep" else {}
    return twin.Experiment(
        joint, excitation, duration, 0.05, seed=seed, parameters=hidden(joint), options=options
    ).run()


@pytest.mark.parametrize("joint", by_day(twin.JOINTS, "shoulder", "shank"))
def test_known_parameters_come_back_from_a_bad_start(joint):
    found = calibrate([record(joint)], joint, names=tuple(CASES[joint]), fixed=("dead_band",))
    assert found.converged
    for name, (value, tolerance) in CASES[joint].items():
        assert abs(found[name].value - value) < tolerance, name
        assert found[name].holds(value), name
        assert abs(found[name].nominal - value) > 5 * tolerance, "the start was not bad"


def test_every_start_is_mapped_back_to_the_parameters_it_came_from():
    """The inverse of the closed forms of `twin.truth`: values of the joint there and back."""
    for joint in twin.JOINTS:
        p = hidden(joint).replace({f"{joint}.asymmetry": 0.2, f"{joint}.rotor_inertia": 4e-7, "delay": 0.03})
        model, data = linear_bench(joint, p)
        damping, inertia, per_volt = closed_form(joint, p, model, data)
        held, r = load(joint, p, model, data), abs(arm(joint, p))
        volts = {}
        for name, way in (("coulomb_up", 1), ("coulomb_down", -1)):
            dry = p[f"{joint}.coulomb"] * (1 + way * p[f"{joint}.asymmetry"]) + p[f"{joint}.load_friction"] * abs(held)
            force = held + way * (dry + p[f"{joint}.bearing_coulomb"] / r)
            volts[name] = force / (per_volt / r) + way * p["dead_band"]
        low, high = end_angles(p, joint)
        half = p[f"{joint}.backlash"] / 2 if joint == "shoulder" else 0.0
        values = {
            "speed_per_volt": per_volt / damping,
            "time_constant": inertia / damping,
            "end_low": low - half,
            "end_high": high + half,
            "delay": 0.03,
            **volts,
        }
        known = {name: JointValue(name, v, v - 1e-4, v + 1e-4, "") for name, v in values.items()}
        rows = mapped_rows(joint, twin.Parameters(), known, usual(joint))
        assert set(rows) >= {f"{joint}.{name}" for name in ("coulomb", "asymmetry", "rotor_inertia")}
        for name, value in rows.items():
            assert value == pytest.approx(p[name], rel=1e-3), name


def test_a_servo_log_is_calibrated_from_where_the_twin_stands():
    """Reference in, angle out: the gain of the position loop and the friction shape the response."""
    p = twin.Parameters({"thigh.servo_kp": 120.0, "thigh.coulomb": 40.0})
    options = {"hold": 2.0, "steps": 3}
    log = twin.Experiment("thigh", "staircase", 20.0, 0.05, parameters=p, mode="servo", options=options).run()
    found = calibrate([log], "thigh", names=("servo_kp", "no_load_speed"), base=p.replace({"thigh.servo_kp": 200.0}))
    assert found["servo_kp"].holds(120.0)
    assert found["servo_kp"].value == pytest.approx(120.0, rel=0.1)
    assert found["no_load_speed"].value == pytest.approx(0.0144, rel=0.02)


def test_a_turn_is_no_end():
    """The shank turns round 10 degrees before its lower end; its stroke must not be taken to end there."""
    options = {"half_period": 6.0, "first": 0.8}
    log = twin.Experiment("shank", "sweep", 20.0, 0.05, parameters=hidden("shank"), options=options).run()
    assert np.rad2deg(log.y.min() - end_angles(hidden("shank"), "shank")[0]) > 5.0
    start = from_joint([log], "shank", twin.Parameters(), usual("shank"))
    assert "shank.retracted_length" not in start.taken
    assert "shank.retracted_length" in start.missed


def test_a_start_does_not_strike_an_end_that_the_log_passes():
    """Begun with a lower end 5 degrees inside the log's range; the other end stays where it was."""
    log = twin.Experiment("shank", "sweep", 20.0, 0.05, options={"half_period": 6.0, "first": 0.8}).run()
    nominal = twin.Parameters()
    inside = linkage(nominal, "shank").length(float(log.y.min()) + np.deg2rad(5.0)) - nominal["shank.retracted_length"]
    short = {
        "shank.retracted_length": nominal["shank.retracted_length"] + inside,
        "shank.stroke": nominal["shank.stroke"] - inside,
    }
    start = from_joint([log], "shank", nominal.replace(short), ("shank.coulomb",))
    low, high = np.rad2deg(end_angles(start.parameters, "shank"))
    assert 1.0 < np.rad2deg(log.y.min()) - low < 3.0
    assert high == pytest.approx(np.rad2deg(end_angles(nominal, "shank")[1]), abs=1e-6)


def test_an_end_that_was_never_reached_is_not_told():
    """Only down: the lower end is reached, the upper one cannot be seen."""
    options = {"half_period": 3.0, "offset": -10.0, "amplitude": 2.0}
    log = twin.Experiment("thigh", "sweep", 9.0, 0.05, options=options).run()
    found = calibrate([log], "thigh", names=("retracted_length", "stroke"), fixed=("dead_band",))
    assert list(found.fixed) == ["thigh.stroke"]
    assert "No log rests at the end stop that thigh.stroke places" in found.fixed["thigh.stroke"]
    assert found.parameters["thigh.stroke"] == twin.Parameters()["thigh.stroke"]
    assert found["retracted_length"].holds(0.202)


@pytest.fixture(scope="module")
def small():
    """A calibration of two parameters, one of which the log does not tell, with a held-out log."""
    logs = [record("shoulder", duration=8.0), record("shoulder", 6, "aprbs", 8.0)]
    return calibrate(logs[:1], "shoulder", names=("upper", "no_load_speed"), held_out=logs[1:])


def test_the_held_out_log_is_not_used_and_predicted(small):
    assert [score.held_out for score in small.scores] == [False, True]
    assert small.found.p.shape == (3,)  # two parameters and one start: nothing of the second log
    assert small.scores[1].fit_after > small.scores[1].fit_before + 2
    run = small.runs[1]
    rms = np.sqrt(np.mean((run.y - run.after) ** 2))
    assert small.scores[1].fit_after == pytest.approx(100 * (1 - rms / np.std(run.y)))


def test_the_file_gives_back_every_bit_and_names_intervals_and_logs(small, tmp_path):
    path = advice.write(small, tmp_path / "shoulder.toml")
    back = read(path)
    assert back.values == small.parameters.values
    text = path.read_text(encoding="utf-8")
    assert "95 % interval" in text
    assert "Logs: log 1." in text
    assert (
        main(
            ["simulate", "--joint", "shoulder", "--duration", "2", "--params", str(path), "--out", str(tmp_path / "o")]
        )
        == 0
    )


def test_rows_are_named_shortly_and_unknown_ones_are_refused():
    assert rows_to_free("thigh", ("coulomb", "dead_band"), (), ()) == ("thigh.coulomb", "dead_band")
    assert "thigh.stribeck" not in rows_to_free("thigh", None, (), ("stribeck",))
    assert "thigh.stroke" not in rows_to_free("thigh", None, ("stroke",), ())
    with pytest.raises(InputError, match="parameter of the thigh"):
        rows_to_free("thigh", ("shank.stroke",), (), ())
    with pytest.raises(InputError, match="left out"):
        rows_to_free("thigh", ("stribeck",), (), ("stribeck",))
    with pytest.raises(InputError, match="both free and fixed"):
        rows_to_free("thigh", ("stroke",), ("stroke",), ())


@pytest.mark.parametrize("joint", twin.JOINTS)
def test_what_to_record_names_commands_that_exist(joint, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = {what_to_record(joint, row) for row in own_rows(joint)}
    commands = [text.partition("qpal ")[2].removesuffix(" shows how").split() for text in said if "qpal " in text]
    assert len(commands) >= 4
    for k, command in enumerate(commands):
        assert main([*command, "--duration", "2", "--out", str(tmp_path / str(k))]) == 0
    assert ROWS


def test_a_capture_with_garbled_lines_is_the_log(tmp_path):
    """Every sample of a capture that was not garbled comes back to a code and a duty count; the others are filled."""
    rig = StandIn("shoulder", 501)
    (ends, _), _, mapping = standin.written(rig, tmp_path)
    log, back = rig.calibration()[0], twin.Log.load(ends, str(mapping), "shoulder")
    assert back.N == log.N
    filled = list(back.meta["filled"])
    assert len(filled) == log.N // 200
    whole = np.setdiff1d(np.arange(log.N), filled)
    np.testing.assert_allclose(back.y[whole], log.y[whole], rtol=0, atol=1e-9)
    np.testing.assert_allclose(back.u[whole], log.u[whole], rtol=0, atol=1e-9)


@pytest.mark.nightly
@pytest.mark.long
@pytest.mark.slow
def test_intervals_hold_although_the_twin_lacks_effects(seeds):
    """Stand-ins with effects that the twin lacks; scripts/studies/calibration.py counts more of them."""
    held = []
    everywhere = [(joint, seed) for seed in seeds[: len(seeds) // 12] for joint in twin.JOINTS]
    for joint, seed in everywhere if len(seeds) > 12 else everywhere[:1]:
        rig = StandIn(joint, 500 + seed)
        found = calibrate(rig.calibration(), joint, without=LACKS, held_out=[rig.fresh()])
        held += [value.holds(rig.parameters[value.name]) for value in found.values]
        score = found.scores[-1]
        assert score.rms_after < 0.5 * score.rms_before
    assert np.mean(held) >= 0.8
