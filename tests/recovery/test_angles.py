"""Angles of a file: wraps at a turn are undone before a fit and said; settings count in the unit of the column."""

from pathlib import Path

import numpy as np
import pytest

from sysid.blocks import Motor, ServoMotor
from sysid.report import identify as report
from sysid.structures import ActuatedJoint, MotorProfile, OutputError, ServoJoint, actuated_joint, servo_joint
from sysid.workflow.identification import identify_file
from sysid.workflow.record import read_record, without_wraps
from sysid.workflow.saved import export
from sysid.workflow.setting import Setting, in_unit_of

N, TS = 700, 0.05
TURN = {"rad": 2.0 * np.pi, "deg": 360.0}


def motion(seed: int, gain: float = 0.03, **stops: float) -> tuple[np.ndarray, np.ndarray]:
    """Volts and angle [rad] of a motor with friction, over several turns unless stops end it."""
    rng = np.random.default_rng([seed, 71])
    chain = actuated_joint(motor=Motor(load=0, stops=bool(stops)), knots=None, play=False)
    known = {"motor.gain": gain, "motor.lag": 3.0, "motor.rise": 1.2, "motor.fall": 1.5, "motor.x0": 1.0}
    known |= {f"motor.{name}": value for name, value in stops.items()}
    u = np.repeat(rng.uniform(-10.0, 10.0, N // 20), 20)
    return u, chain.simulate(np.array([known.get(name, 0.0) for name in chain.names]), u)


def saved(file: Path, u: np.ndarray, y: np.ndarray, unit: str = "rad", input: str = "voltage [V]") -> Path:
    rows = np.column_stack([TS * np.arange(len(u)), u, y])
    np.savetxt(file, rows, delimiter=",", header=f"time [s],{input},angle [{unit}]", comments="", fmt="%.12g")
    return file


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_a_wrapped_record_gives_the_fit_of_the_angle_that_counts_on(unit: str, tmp_path: Path) -> None:
    u, y = motion(0)
    y *= TURN[unit] / TURN["rad"]
    y += 0.001 * np.std(y) * np.random.default_rng(0).normal(size=N)
    shown = np.mod(y, TURN[unit])
    turns = int(np.sum(np.abs(np.diff(shown)) > 0.5 * TURN[unit]))
    assert turns > 3
    setting = Setting(MotorProfile(knots=1), starts=2)
    whole, wrapped = (
        identify_file(saved(tmp_path / f"{name}.csv", u, values, unit), setting)
        for name, values in (("whole", y), ("wrapped", shown))
    )
    np.testing.assert_allclose(wrapped.record.data.y, whole.record.data.y, atol=1e-8)
    assert wrapped.evaluation.validation_fit == pytest.approx(whole.evaluation.validation_fit, abs=1e-4)
    assert wrapped.evaluation.validation_fit > 95.0
    note = f"column 'angle [{unit}]': {turns} wraps of the output at 6.28319 undone"
    assert any(note in n for n in wrapped.record.notes)
    assert not any("wrap" in n for n in whole.record.notes)
    assert any(note in sentence for sentence in report.terminal_sentences(wrapped))
    (tmp_path / "pictures").mkdir()
    page = report.page(wrapped, export(wrapped.evaluation, tmp_path / "pictures"))
    assert note[1:] in str(page.sections[0])


def test_a_block_model_keeps_what_its_file_holds(tmp_path: Path) -> None:
    u, y = motion(0)
    found = identify_file(saved(tmp_path / "log.csv", u, np.mod(y, TURN["rad"])), Setting(OutputError(1, 1, 1)))
    assert np.ptp(found.record.data.y) <= TURN["rad"]


def test_a_goal_that_wraps_stays_beside_its_angle(tmp_path: Path) -> None:
    """Steps of up to 0.45 turns; the goal jumps a turn before the angle does."""
    rng = np.random.default_rng(3)
    goal = np.repeat(np.cumsum(rng.uniform(-0.45, 0.45, N // 20)), 20) * TURN["rad"]
    chain = servo_joint(ServoMotor(load=0, stops=False), False, kp=2.0)
    known = {"motor.gain": 0.2, "motor.lag": 1.5, "motor.rise": 0.02, "motor.fall": 0.02, "motor.x0": goal[0]}
    y = chain.simulate(np.array([chain.fixed.get(n, known.get(n, 0.0)) for n in chain.names]), goal)
    assert np.ptp(goal) > TURN["rad"]
    assert np.ptp(y) > TURN["rad"]
    file = saved(tmp_path / "servo.csv", *(np.mod(x, TURN["rad"]) for x in (goal, y)), input="goal [rad]")
    data = without_wraps(read_record(file)).data
    for shown, true in ((data.u, goal), (data.y, y)):
        turns = (shown[:, 0] - true) / TURN["rad"]
        np.testing.assert_allclose(turns, round(turns[0]), atol=1e-9)
    np.testing.assert_allclose(data.u[:, 0] - data.y[:, 0], goal - y, atol=1e-9)


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_records_without_wraps_stay_untouched(unit: str, tmp_path: Path) -> None:
    """Ten joints that strike their stops less than a turn apart, and ten that go over several turns, with noise."""
    for seed in range(10):
        for name, stops in (("stops", {"lower": 0.2, "upper": 0.98 * TURN["rad"]}), ("free", {})):
            u, y = motion(seed, 0.5 if stops else 0.03, **stops)
            y = (y + 0.01 * np.random.default_rng(seed).normal(size=N)) * TURN[unit] / TURN["rad"]
            record = read_record(saved(tmp_path / f"{name}{seed}.csv", u, y, unit))
            assert without_wraps(record) is record, (seed, name)


def test_settings_count_in_the_unit_of_the_column(tmp_path: Path) -> None:
    """Degrees become radians as they are read, and a person's numbers with them."""
    u, y = motion(1)
    degrees = read_record(saved(tmp_path / "deg.csv", u, np.degrees(y), "deg"))
    radians = read_record(saved(tmp_path / "rad.csv", u, y, "rad"))
    recipe, record = in_unit_of(degrees, ActuatedJoint(load="periodic", stops="none", period=360.0))
    assert recipe.period == pytest.approx(2.0 * np.pi)
    assert record.notes[-1] == "--period counts in the unit of column 'angle [deg]', deg"
    given = ActuatedJoint(load="periodic", stops="none", period=6.0)
    assert in_unit_of(radians, given) == (given, radians)
    servo, record = in_unit_of(degrees, ServoJoint("pid", kp=0.04, kd=0.002, ki=0.1, dead=0.5, limit=7.4))
    expected = {"kp": 0.04 * 180 / np.pi, "kd": 0.002 * 180 / np.pi, "ki": 0.1 * 180 / np.pi, "dead": np.radians(0.5)}
    assert {name: getattr(servo, name) for name in expected} == pytest.approx(expected)
    assert servo.limit == 7.4
    assert record.notes[-1].startswith("--kp and --dead and --kd and --ki count in")


def test_a_turn_is_360_in_degrees_unless_it_is_given(tmp_path: Path) -> None:
    """Of data whose unit is degrees; those of a file are read as radians."""
    u, y = motion(1)
    data = read_record(saved(tmp_path / "rad.csv", u, y)).data
    for unit in ("rad", "deg"):
        own = type(data)(u, y, TS, y_unit=unit)
        plain = ActuatedJoint(load="periodic", stops="none")
        assert plain.model_of(own).blocks[0].period == pytest.approx(TURN[unit])
        assert ServoJoint().model_of(own).blocks[0].period == pytest.approx(TURN[unit])
        given = ActuatedJoint(load="periodic", stops="none", period=5.0)
        assert given.model_of(own).blocks[0].period == 5.0
