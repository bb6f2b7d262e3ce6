"""Records whose origin is known: filters and block models are refused, joints are not, and the refusal comes first."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from often import often
from scipy.signal import lfilter

from sysid.blocks import Motor
from sysid.data.record import IOData
from sysid.excitations import Aprbs
from sysid.joint import verdict as rules
from sysid.joint.posterior import JointFit, fit_joint
from sysid.joint.verdict import verdict
from sysid.report import identify as report
from sysid.structures import ActuatedJoint, actuated_joint
from sysid.workflow.identification import identify_file
from sysid.workflow.saved import export
from sysid.workflow.setting import Setting

N, TS = 700, 0.05


def levels(rng: np.random.Generator) -> np.ndarray:
    return Aprbs(10.0).generate(N, TS, rng)


def second_order(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A filter that a motor against a spring without friction would be, too."""
    u = levels(rng)
    return u, lfilter([0.0, 0.05, 0.04], np.convolve([1.0, -0.9], [1.0, -0.8]), u)


def dead_zone(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """What friction does to small inputs, and no motor."""
    u = levels(rng)
    return u, lfilter([0.0, 0.1], [1.0, -0.9], np.sign(u) * np.maximum(np.abs(u) - 3.0, 0.0))


def unrelated(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return levels(rng), lfilter([1.0], [1.0, -0.7], rng.normal(size=N))


def joint(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A motor of known friction between two stops that it meets."""
    chain = actuated_joint(motor=Motor(load=3), play=False)
    known = {"motor.gain": 0.006, "motor.lag": 2.0, "motor.rise": 1.2, "motor.fall": 1.5, "motor.upper": 1.0}
    known |= {"map.low": -0.5, "map.high": 0.9, "motor.x0": 0.5, "map.angle0": 0.9, "map.angle1": 2.3}
    u = levels(rng)
    return u, chain.simulate(np.array([known.get(name, 0.0) for name in chain.names]), u)


def record(made, seed: int = 0) -> IOData:
    """A record with noise of half a percent."""
    rng = np.random.default_rng([seed, 61])
    u, y = made(rng)
    return IOData(u, y + 0.005 * np.std(y) * rng.normal(size=N), TS)


@pytest.mark.parametrize(
    ("made", "why"),
    [(second_order, "no dry friction"), (dead_zone, "Hammerstein-Wiener"), (unrelated, "no joint explains it")],
)
def test_a_record_that_no_motor_made_is_not_a_joint_and_the_reason_says_why(made, why: str) -> None:
    data = record(made)
    said = verdict(fit_joint(data, parts=()), data)
    assert not said.joint
    assert why in said.sentence()
    assert said.sentence().startswith("This record is not that of an actuated joint")


def test_a_joint_is_a_joint_and_its_friction_is_that_of_the_record() -> None:
    data = record(joint)
    found = fit_joint(data, parts=())
    said = verdict(found, data)
    assert said.joint
    assert said.sentence() == ""
    assert found.ends == "both"
    assert said.friction == pytest.approx(1.35 / np.std(data.u), rel=0.05)
    assert said.general_unseen < said.unseen


@pytest.mark.parametrize(("unseen", "is_joint"), [(0.99, False), (0.5, True)])
def test_bic_alone_refuses_no_joint_that_is_clearly_better_on_unseen_parts(unseen, is_joint, monkeypatch) -> None:
    """Beside a general model of lower BIC whose error on unseen parts is the joint's divided by `unseen`."""
    data = record(joint)
    found = fit_joint(data, parts=())
    error = (100.0 - found.unseen_percent) / unseen
    criteria = SimpleNamespace(bic=found.fit.criteria.bic - 1e4, mse=found.fit.criteria.mse)
    general = SimpleNamespace(model=None, theta=None, criteria=criteria)
    monkeypatch.setattr(rules, "_fit_general", lambda chain, data: general)
    monkeypatch.setattr(rules, "holdout_errors", lambda *args: SimpleNamespace(percent=100.0 - error))
    said = verdict(found, data)
    assert said.joint is is_joint
    assert ("explains it as well" in said.reason) is not is_joint


def test_a_refusal_is_the_first_sentence_and_no_physical_value_is_told(tmp_path: Path) -> None:
    data = record(second_order)
    file = tmp_path / "log.csv"
    rows = np.column_stack([TS * np.arange(N), data.u, data.y])
    np.savetxt(file, rows, delimiter=",", header="time [s],u [V],y [rad]", comments="")
    result = identify_file(file, Setting(ActuatedJoint(), starts=2))
    first = result.evaluation.joint.sentence()
    assert first.startswith("This record is not that of an actuated joint")
    page = report.page(result, export(result.evaluation, tmp_path))
    assert (page.answer.word, page.answer.sentence) == ("usable", first)
    assert page.answer.next.endswith(result.next.command)
    told = json.loads(json.dumps(result.as_dict()))
    assert told["verdict"] == first
    assert told["joint"]["joint"] is False
    assert "values" not in told
    assert result.evaluation.values == ()
    printed = json.dumps([[grid.caption, grid.rows] for grid in report.terminal_tables(result)])
    assert "per volt" not in printed
    assert result.next.command == f"qpal identify {file} --structure auto"


def without_stops(seed: int) -> tuple[IOData, JointFit]:
    """A motor in the unit of its sensor, which nothing ends."""
    rng = np.random.default_rng([seed, 62])
    chain = actuated_joint(motor=Motor(load=0, stops=False), knots=None, play=False)
    known = {"motor.gain": 0.02, "motor.lag": 3.0, "motor.rise": 1.2, "motor.fall": 1.5}
    u = levels(rng)
    y = chain.simulate(np.array([known.get(name, 0.0) for name in chain.names]), u)
    data = IOData(u, y + 0.003 * np.std(y) * rng.normal(size=N), TS)
    return data, fit_joint(data, parts=())


@pytest.mark.parametrize("seed", often(4, 1))
def test_a_motor_without_stops_gets_none(seed: int) -> None:
    _, found = without_stops(seed)
    assert found.ends in ("straight", "none")
    assert "end stop" in found.sentence()
    value = dict(zip(found.fit.model.names, found.fit.theta, strict=True))
    assert value["motor.rise"] == pytest.approx(1.2, rel=0.1)
    assert not {"motor.lower", "motor.upper"} & set(value)


def test_a_pendulum_over_several_turns_gets_a_load_that_repeats() -> None:
    """Volts to an angle without end: the pull is a sine of the angle, which no parabola follows."""
    rng = np.random.default_rng(63)
    chain = actuated_joint(motor=Motor(load=0, periodic=1, stops=False), knots=None, play=False)
    known = {"motor.gain": 0.03, "motor.lag": 3.0, "motor.rise": 0.8, "motor.fall": 0.9, "motor.sine1": 3.0}
    u = levels(rng)
    y = chain.simulate(np.array([known.get(name, 0.0) for name in chain.names]), u)
    assert np.ptp(y) > 2 * np.pi
    data = IOData(u, y + 0.003 * rng.normal(size=N), TS, y_unit="rad")
    found = fit_joint(data)
    assert found.fit.model.blocks[0].periodic == 1
    value = dict(zip(found.fit.model.names, found.fit.theta, strict=True))
    assert value["motor.sine1"] == pytest.approx(3.0, rel=0.05)
    assert value["motor.rise"] + value["motor.load0"] == pytest.approx(0.8, rel=0.05)  # told apart by a loss alone
    assert found.unseen_percent > 97.0
