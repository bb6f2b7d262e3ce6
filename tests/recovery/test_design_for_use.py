"""Experiments for an input of use: what they are expected to bring by a fit to both records, and what they bring."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from often import often

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.excitations import Aprbs, Sweep
from sysid.joint.clock import Clock
from sysid.joint.course import Course
from sysid.joint.design import design
from sysid.joint.full import full_joint
from sysid.joint.posterior import fit_joint
from sysid.joint.use import add_parts_for_use
from sysid.structures import actuated_joint
from sysid.uncertainty.information import information
from sysid.workflow.design import _beyond, input_of_use
from sysid.workflow.record import read_record
from twin.cli import main

TS, NOISE = 0.1, np.deg2rad(0.2)
SHAPE = {"angle0": 0.9, "angle1": 2.2, "stroke": 0.4}
TRUE = {
    **{"motor.gain": 0.0019, "motor.lag": 0.55, "motor.rise": 1.9, "motor.fall": 2.2, "motor.delay": 0.3},
    **{"motor.load1": 0.7, "motor.load2": -0.4, "motor.upper": 1.0, "motor.x0": 0.45},
    **{"motor.stick": 0.5, "motor.stick_down": 0.5, "motor.stick_speed": 0.001, "motor.loss": 0.3, "motor.load0": 0.3},
    **{"map.low": -0.9, "map.high": 0.4, "play.width": 0.015, "play.drag": 0.1, "play.pull1": 0.5},
    **{f"{role}.{name}": value for role in ("map", "motor") for name, value in SHAPE.items()},
}
JOINT = full_joint(actuated_joint(play=False))
THETA = np.array([TRUE.get(name, 0.0) for name in JOINT.names])


def played(u, seed):
    y = JOINT.simulate(THETA, u) + NOISE * np.random.default_rng([seed, 61]).standard_normal(len(u))
    return IOData(u, y, TS, u_unit="V", y_unit="rad")


def drawn(excitation, N, seed):
    return excitation.generate(N, TS, np.random.default_rng([seed, 62]))


def off(fit, data):
    """Root mean square of the free run's distance from the joint without noise."""
    return float(np.std(JOINT.simulate(THETA, data.u[:, 0]) - np.ravel(fit.simulate(data))))


def written(data, path):
    rows = np.column_stack([np.arange(data.N) * TS, data.u[:, 0], np.degrees(data.y[:, 0])])
    np.savetxt(path, rows, delimiter=",", header="time [s],u [V],angle [deg]", comments="", fmt="%.9g")
    return path


@pytest.fixture(scope="module")
def first():
    data = played(drawn(Sweep(12.0, 7.0, jitter=0.4, shrink=0.4), 600, 0), 0)
    return data, fit_joint(data, starts=2).fit  # from few starts, without the lower end: a joint that has much to learn


def test_the_expected_deviation_is_that_of_the_information_of_both_records(first):
    """By the information of a record that the model itself makes, with the factor of the first for what it knew."""
    data, fit = first
    use = drawn(Aprbs(12.0), 300, 1)
    found = design(fit, data, to_stops=True, use=use)
    assert found.use is not None
    assert found.use.deviations[1] < 0.7 * found.use.deviations[0]
    record = IOData(found.u, fit.model.simulate(fit.theta, found.u), TS)
    both = information(fit, IOData.merge(data, record), lags=None)
    J = np.where(fit.model.initial, 0.0, fit.model.tangent(fit.theta, use)[1])
    before, after = (
        expected / float(np.sqrt(np.mean(np.nan_to_num(known.std_of(J)) ** 2)))
        for known, expected in zip((information(fit, data, lags=None), both), found.use.deviations, strict=True)
    )
    # The first record's information allows for changes between its parts and for colour, the new one's for noise alone:
    # what both tell is between the two, and nearer to noise alone.
    assert 0.9 < after < np.sqrt(before)


@pytest.mark.parametrize("seed", often(4, 1))
def test_the_experiment_brings_the_free_run_over_inputs_of_use_nearer_to_the_joint(first, seed):
    data, fit = first
    found = design(fit, data, to_stops=True, use=drawn(Aprbs(12.0), 900, 10 + seed))
    assert found.duration <= 400.0
    both = fit_joint(IOData.merge(data, played(found.u, 20 + seed))).fit
    others = [played(drawn(Aprbs(12.0), 600, 30 + seed + k), k) for k in range(3)]
    before, after = (float(np.mean([off(each, other) for other in others])) for each in (fit, both))
    assert after < 0.3 * before


@pytest.mark.nightly
def test_it_stays_where_the_joint_was_seen_unless_it_may_run_into_stops():
    data = played(drawn(Sweep(5.0, 3.0, jitter=0.2, shrink=0.4), 600, 3), 3)
    fit = fit_joint(data).fit
    assert not np.isclose(data.y.max(), TRUE["map.high"], atol=0.02)
    found = design(fit, data, volts=12.0, use=drawn(Aprbs(12.0), 300, 4))
    way = np.ptp(data.y)
    assert data.y.min() - 0.05 * way < found.y.min()
    assert found.y.max() < data.y.max() + 0.05 * way


def test_an_input_that_the_record_tells_already_is_no_reason_for_an_experiment(first):
    data, fit = first
    course = Course.of(fit, data, 12.0, None, TS, to_stops=True)
    with pytest.raises(InputError, match="the first record tells what this input needs"):
        add_parts_for_use(fit, data, data.u[:100, 0], course, [], noise=1.0, clock=Clock())


def test_the_command_reads_an_input_of_another_sampling_time_and_shows_what_it_brings(first, tmp_path):
    data, _ = first
    log, use, out = tmp_path / "log.csv", tmp_path / "use.csv", tmp_path / "out"
    written(data, log)
    wanted = drawn(Aprbs(12.0), 300, 5)
    rows = np.column_stack([np.arange(600) * TS / 2, np.repeat(wanted, 2)])
    np.savetxt(use, rows, delimiter=",", header="time [s],u [V]", comments="", fmt="%.9g")
    assert main(["design", str(log), "--for-use", str(use), "--to-stops", "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    now, then = summary["use"]["deviation"]
    assert then < now
    assert summary["next"].split()[2] == str(log)
    assert (out / "figures/use.png").exists()
    # The parts that tell most for their time need not go as far as the input of use: then the note says how far.
    levels = np.concatenate([np.loadtxt(out / "design.csv", delimiter=",", skiprows=1)[:, 1], data.u[:, 0]])
    short = max(levels.min() - wanted.min(), wanted.max() - levels.max()) > 0.05 * np.ptp(levels)
    notes = " ".join(summary["notes"])
    assert ("beyond this the expected deviation is not tried" in notes) == short
    assert ("allow it with --volts 11.76" in notes) == (short and np.abs(data.u).max() < np.abs(wanted).max())
    use.write_text("t,x\n0,1\n1,2\n")
    assert main(["design", str(log), "--for-use", str(use), "--out", str(out)]) != 0


@pytest.mark.nightly
def test_where_no_experiment_helps_the_report_says_why_and_has_the_one_without_the_input(first, tmp_path):
    """Under 0.05 V the joint stands, which its record tells."""
    data, _ = first
    log, use, out = written(data, tmp_path / "log.csv"), tmp_path / "use.csv", tmp_path / "out"
    rows = np.column_stack([np.arange(300) * TS, 0.05 * np.sin(np.arange(300) * TS)])
    np.savetxt(use, rows, delimiter=",", header="time [s],u [V]", comments="", fmt="%.9g")
    assert main(["design", str(log), "--to-stops", "--out", str(tmp_path / "plain")]) == 0
    assert main(["design", str(log), "--for-use", str(use), "--to-stops", "--out", str(out)]) == 0
    summary, plain = (json.loads((folder / "summary.json").read_text()) for folder in (out, tmp_path / "plain"))
    assert summary["use"] is None
    assert "off by 0 deg, little beside a reading" in summary["no_use"]
    assert summary["phases"] == plain["phases"]
    assert (out / "design.csv").read_text() == (tmp_path / "plain/design.csv").read_text()
    assert (out / "report.html").read_text().count("the first record tells what this input needs") >= 2
    assert not (out / "figures/use.png").exists()


@pytest.mark.parametrize(
    ("wanted", "found"), [(np.full(50, 3.0), "50 samples from 3 to 3"), (np.arange(3), "has 3 samples")]
)
def test_an_input_of_use_that_is_no_motion_is_refused(wanted, found, first, tmp_path):
    record = read_record(written(first[0], tmp_path / "log.csv"))
    with pytest.raises(InputError, match=found):
        input_of_use(str(written(played(wanted, 0), tmp_path / "use.csv")), record)


def test_a_note_says_where_the_input_of_use_goes_beyond_what_is_tried(first):
    data, _ = first
    tried = SimpleNamespace(u=np.array([-9.0, 8.0]), units=("V", "rad"))
    largest = np.abs(data.u).max()
    assert _beyond(np.array([-0.5, 0.9 * largest]), tried, data) == ()
    (note,) = _beyond(np.array([-0.5, 20.0]), tried, data)
    assert note.startswith("the input of use goes from -0.5 to 20 V")
    assert "--volts 20" in note
    assert "--volts" not in _beyond(np.array([-0.5, 20.0]), tried, data, volts=24.0)[0]
