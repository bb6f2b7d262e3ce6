"""The record of a joint shows the parts that it has, and no others; fits from several starts of one's own.

Every plant is a chain with parameters written down here, and the fit sees records of it alone.
"""

import json
from functools import cache

import numpy as np
import pytest
from often import by_day
from scipy.signal import lfilter
from scipy.stats import truncnorm

import sysid
from sysid.base.errors import InputError
from sysid.blocks import CoastingPlay, Motor
from sysid.data.record import IOData
from sysid.excitations import Staircase, Sweep
from sysid.joint import parts
from sysid.joint.posterior import JointFit, fit_joint
from sysid.joint.values import joint_values
from sysid.model.chain import Chain
from sysid.structures import actuated_joint

pytestmark = pytest.mark.long  # all of them: they share the fits

TS, N, NOISE = 0.1, 1000, np.deg2rad(0.2)
SHAPE = {"angle0": 0.9, "angle1": 2.2, "stroke": 0.4}
PLAIN = {
    **{"motor.gain": 0.0019, "motor.lag": 0.55, "motor.rise": 1.9, "motor.fall": 2.2, "motor.delay": 0.3},
    **{"motor.load1": 0.7, "motor.load2": -0.4, "motor.upper": 1.0},
    **{"map.low": -0.9, "map.high": 0.4},
    **{f"{role}.{name}": value for role in ("map", "motor") for name, value in SHAPE.items()},
}
STRIBECK = {"motor.stick": 0.6, "motor.stick_speed": 0.002}
SCREW = {"motor.load0": 0.8, "motor.loss": 0.4, "motor.jam": 400.0}  # 7 samples at full speed
COASTS = {"play.width": 0.02, "play.drag": 0.003, "play.rest": 0.2}
MOTORS = {
    "plain": Motor(load=3),
    "stribeck": Motor(load=3, stribeck=True, substeps=4),
    "screw": Motor(load=3, loss=True, jams=True),
    "all": Motor(load=3, stribeck=True, loss=True, jams=True, substeps=4),
}
LINK = CoastingPlay()
PLANTS: dict[str, tuple[Chain, dict[str, float], set[str]]] = {
    "plain": (actuated_joint(play=False), {}, set()),
    "stribeck": (actuated_joint(motor=MOTORS["stribeck"], play=False), STRIBECK, {"stick", "stick_down"}),
    "screw": (actuated_joint(motor=MOTORS["screw"], play=False), SCREW, {"loss"}),
    "coasts": (actuated_joint(play=LINK), COASTS, {"width"}),
    "all": (
        actuated_joint(motor=MOTORS["all"], play=LINK),
        STRIBECK | SCREW | COASTS,
        {"stick", "stick_down", "loss", "width"},
    ),
}


def theta_of(chain: Chain, more: dict[str, float]) -> np.ndarray:
    return np.array([(PLAIN | more).get(name, 0.0) for name in chain.names])


def record(plant: str, seed: int) -> IOData:
    """Three experiments: two drawn sweeps, and stairs that show at what voltage the joint starts."""
    chain, more, _ = PLANTS[plant]
    rng = np.random.default_rng([seed, 23])
    inputs = [Sweep(12.0, 7.0, jitter=0.4, shrink=0.4).generate(N, TS, rng) for _ in range(2)]
    inputs.append(Staircase(amplitude=7.0, hold=0.1, steps=120, order="stairs").generate(N, TS, rng))
    parts = []
    for u in inputs:
        y = chain.simulate(theta_of(chain, more | {"motor.x0": rng.uniform(0.3, 0.6)}), u)
        parts.append(IOData(u, y + NOISE * rng.normal(size=N), TS))
    return IOData.merge(*parts)


def shown(joint: JointFit) -> set[str]:
    """The parts that the record shows; whether it shows a jam depends on when its turns fall."""
    return {name.split(".")[-1] for name in joint.shown} - {"jam"}


def expected(plant: str) -> dict[str, float]:
    """What the parameters make of volts and angles, by hand: load and loss at mid stroke, where load1, load2 are 0."""
    p = PLAIN | PLANTS[plant][1]
    load, stick = p.get("motor.load0", 0.0), p.get("motor.stick", 0.0)
    lost = p.get("motor.loss", 0.0) * abs(load)
    share = share_at(0.6) - share_at(0.4)
    values = {
        "speed_per_volt": p["motor.gain"] * (p["map.high"] - p["map.low"]) * share / 0.2 / TS,
        "breakaway_up": load + p["motor.rise"] + stick + lost,
        "breakaway_down": load - p["motor.fall"] - stick - lost,
        "end_low": p["map.low"],
        "end_high": p["map.high"],
    }
    return values | ({"backlash": p["play.width"]} if "play.width" in p else {})


def share_at(x: float) -> float:
    """Of the way, at a share of the stroke, by the law of cosines: the actuator is 2 + x long."""
    first, last, length = np.cos(0.9), np.cos(2.2), 2.0 + x  # stroke 0.4: it is 2 strokes long, and 2.5 in the mean
    cosine = first + (last - first) * (length**2 - 4.0) / 5.0
    return float((np.arccos(cosine) - 0.9) / 1.3)


def aims(values: dict[str, float]) -> dict[str, float]:
    """How near each value must come: 2 % of speed, 5 % of volts, 0.3 deg at the ends, 10 % of the play."""
    shares = {"speed_per_volt": 0.02, "breakaway_up": 0.05, "breakaway_down": 0.05, "backlash": 0.1}
    return {name: shares[name] * abs(v) if name in shares else np.deg2rad(0.3) for name, v in values.items()}


def near(joint: JointFit, plant: str) -> dict[str, bool]:
    """By name, whether the value came within its aim; one that the joint has not is not near."""
    true = expected(plant)
    found = {v.name: v.value for v in joint_values(joint.fit)}
    return {name: abs(found.get(name, np.nan) - true[name]) <= aim for name, aim in aims(true).items()}


@cache  # several tests look at the same fit
def fitted(plant: str, seed: int) -> tuple[IOData, JointFit]:
    data = record(plant, seed)
    return data, fit_joint(data)


@pytest.fixture
def stribeck() -> tuple[IOData, JointFit]:
    return fitted("stribeck", 0)


_BY_NIGHT = [pytest.param(plant, marks=pytest.mark.nightly) for plant in ("screw", "coasts", "stribeck")]


@pytest.mark.parametrize("plant", ["all", *_BY_NIGHT])
def test_the_parts_of_a_joint_are_shown_and_it_gets_as_low_as_from_the_truth(plant: str) -> None:
    (data, joint), (chain, more, parts) = fitted(plant, 0), PLANTS[plant]
    assert shown(joint) == parts
    assert all(near(joint, plant).values()), near(joint, plant)
    best = sysid.fit(chain, data, search="lm", start=theta_of(chain, more))
    assert joint.fit.criteria.mse <= 1.02 * best.criteria.mse
    assert np.sqrt(best.criteria.mse) == pytest.approx(NOISE, rel=0.05)


def judged(plant: str, seed: int) -> dict[str, bool]:
    """By name: whether each part is shown or not as the plant has it, whether the fit is as low as from the truth, and
    the values."""
    (data, joint), (chain, more, parts) = fitted(plant, seed), PLANTS[plant]
    told = sysid.fit(chain, data, search="lm", start=theta_of(chain, more))
    as_low = joint.fit.criteria.mse <= 1.05 * told.criteria.mse
    found = shown(joint)
    return {"parts": parts <= found, "no other": found <= parts, "as low": as_low, **near(joint, plant)}


def shares(rows: list[dict[str, bool]]) -> dict[str, float]:
    """How often each name holds, where it stands at all."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: float(np.mean([row[name] for row in rows if name in row])) for name in names}


@pytest.mark.nightly  # by day: all parts at once, and what a fit tells of one part
@pytest.mark.slow
def test_one_part_is_found_over_many_records(seeds: range) -> None:
    found = shares([judged(("stribeck", "screw", "coasts")[seed % 3], seed // 3) for seed in seeds])
    assert found.pop("backlash") >= 0.75, found  # of a third of the records: one in four may miss
    assert all(share >= 0.9 for share in found.values()), found


@pytest.mark.nightly
@pytest.mark.slow
def test_all_parts_at_once_are_found_over_many_records(seeds: range) -> None:
    found = shares([judged("all", seed) for seed in seeds[::2]])
    assert all(share >= 0.75 for share in found.values()), found


@pytest.mark.nightly  # by day: the joints without parts of test_joint_occam.py
@pytest.mark.slow
def test_a_plain_joint_shows_no_part_over_many_records(seeds: range) -> None:
    found = shares([judged("plain", seed) for seed in seeds])
    assert all(share >= 0.95 for share in found.values()), found


def test_the_odds_of_a_part_are_those_of_truncated_normals_at_zero() -> None:
    """By scipy: density at zero of the prior, on what is not negative, over that of the posterior."""
    for value, std, usual, spread in ((0.3, 0.1, 0.2, 0.2), (0.0, 0.2, 0.2, 0.2), (1.0, 0.9, 0.0, 0.5)):
        densities = [truncnorm.pdf(0.0, -m / s, np.inf, m, s) for m, s in ((usual, spread), (value, std))]
        part = parts.PartEvidence("a", "a", "", value, std, usual, spread, parts._odds(value, std, usual, spread))
        assert part.odds == pytest.approx(densities[0] / densities[1], rel=1e-9)
        assert part.verdict == ("shown" if part.odds > 20.0 else "absent" if part.odds < 0.05 else "open")
    assert parts._odds(0.3, np.inf, 0.2, 0.2) == 1.0


def test_odds_are_no_stronger_than_what_a_search_without_the_part_loses(
    stribeck: tuple[IOData, JointFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, joint = stribeck
    monkeypatch.setattr(parts._Heights, "odds_against", lambda *_: 2.0)
    assert {part.verdict for part in parts.parts_of(joint.fit, data)} == {"open"}


def test_a_filter_is_no_joint_and_a_motor_without_friction_follows_it() -> None:
    """A spring of any size: nothing usual draws it towards the friction, of which there is none."""
    rng = np.random.default_rng(44)
    u = Sweep(10.0, 4.0, jitter=0.5, shrink=0.3).generate(600, TS, rng)
    y = lfilter([0.0, 0.05, 0.04], np.convolve([1.0, -0.9], [1.0, -0.8]), u)
    data = IOData(u, y + 0.005 * np.std(y) * rng.normal(size=600), TS)
    assert fit_joint(data).fit.fit_percent(data) > 95.0


def test_a_fit_tells_what_its_record_shows(stribeck: tuple[IOData, JointFit]) -> None:
    _, joint = stribeck
    said = joint.sentence()
    assert said.startswith("The record shows higher friction at rest upward and higher friction at rest downward.")
    assert "It leaves open" in said
    assert "jamming at a struck stop" in said.split("It leaves open")[1]
    told = json.loads(json.dumps(joint.as_dict()))
    assert told["ends"] == "both"
    verdicts = {row["name"]: row["verdict"] for row in told["parts"]}
    assert [name for name, verdict in verdicts.items() if verdict == "shown"] == ["motor.stick", "motor.stick_down"]
    assert set(verdicts) == {"motor.stick", "motor.stick_down", "motor.loss", "motor.jam", "play.width"}


@pytest.mark.nightly
def test_a_fit_is_the_same_every_time_and_has_no_part_that_it_was_not_given(
    stribeck: tuple[IOData, JointFit],
) -> None:
    data, whole = stribeck
    once = fit_joint(data, parts=(name for name in ("jams", "stribeck")))
    assert {name for name in once.fit.model.names if "stick" in name or name.endswith((".jam", ".loss", ".width"))} == {
        *("motor.stick", "motor.stick_speed", "motor.jam")
    }
    np.testing.assert_array_equal(fit_joint(data).fit.theta, whole.fit.theta)
    assert fit_joint(data, parts=()).parts == ()


def test_parts_and_joints_that_do_not_fit_are_refused_in_a_sentence(stribeck: tuple[IOData, JointFit]) -> None:
    data, _ = stribeck
    with pytest.raises(InputError, match="unknown part of a joint 'rust'; choose one of stribeck, sided, loss, jams"):
        fit_joint(data, parts=("stribeck", "rust"))
    rich = (
        actuated_joint(motor=MOTORS["stribeck"], play=False),
        actuated_joint(motor=MOTORS["screw"], play=False),
        actuated_joint(play=LINK),
        actuated_joint(),  # its play is one of the parts
        sysid.structures.output_error(1, 1, 1),
    )
    for chain in rich:
        with pytest.raises(InputError, match="begins with a plain actuated_joint"):
            fit_joint(data, chain)


def test_a_joint_of_ones_own_keeps_its_driver_and_what_it_holds(stribeck: tuple[IOData, JointFit]) -> None:
    data, _ = stribeck
    own = actuated_joint(play=False, driver_step=0.05, fixed={"motor.delay": 0.3}, bounds={"motor.lag": (0.2, 0.9)})
    fit = fit_joint(data, own, parts=("stribeck",)).fit
    assert [b.role for b in fit.model.blocks] == ["levels", "motor", "map"]
    value = dict(zip(fit.model.names, fit.theta, strict=True))
    assert value["motor.delay"] == 0.3
    assert 0.2 <= value["motor.lag"] <= 0.9


@pytest.fixture(scope="module")
def points() -> tuple[Chain, IOData, np.ndarray]:
    """A chain, a record of it, and starts (3, P): the truth between two that are off it."""
    chain, data = PLANTS["plain"][0], record("plain", 0).experiments[0]
    true = theta_of(chain, {"motor.x0": 0.45})
    scale = np.array([1.0 if name.startswith("map") else 1.3 for name in chain.names])
    return chain, data, np.array([true * scale**3, true, true * scale])


def test_a_fit_from_several_starts_is_the_best_of_those_from_each(points: tuple[Chain, IOData, np.ndarray]) -> None:
    chain, data, rows = points
    singles = [sysid.fit(chain, data, search="lm", start=row) for row in rows]
    together = sysid.fit(chain, data, search="lm", start=rows)
    best = min(singles, key=lambda fit: fit.criteria.loss)
    assert len(together.losses) == 3
    assert together.criteria.loss == pytest.approx(best.criteria.loss, rel=1e-6)
    np.testing.assert_allclose(chain.simulate(together.theta, data.u), chain.simulate(best.theta, data.u), atol=1e-5)
    row = sysid.fit(chain, data, search="lm", start=rows[1:2])
    np.testing.assert_array_equal(row.theta, singles[1].theta)


def test_starts_of_a_wrong_shape_are_refused_in_a_sentence(points: tuple[Chain, IOData, np.ndarray]) -> None:
    chain, data, rows = points
    P = len(chain.names)
    for wrong in (rows[0, 1:], rows[:, 1:], rows[:0], rows[None], np.full((2, P), np.nan), 1.0):
        with pytest.raises(InputError, match=f"give {P} finite values, one for each parameter, or several such rows"):
            sysid.fit(chain, data, start=wrong)


def test_a_joint_whose_parts_run_away_is_the_plain_one(
    stribeck: tuple[IOData, JointFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, _ = stribeck

    def away(*_: object) -> None:
        raise InputError("none of 1 start(s) gives a valid model")

    monkeypatch.setattr("sysid.joint.posterior.best_points", away)
    joint = fit_joint(data)
    assert joint.parts == ()
    assert np.all(np.isfinite(joint.fit.simulate(data.u)))
    assert joint.fit.fit_percent(data) > 90.0


@pytest.mark.parametrize("case", by_day(["gap", "gap at first", "no input"], "gap at first", "no input"))
def test_a_record_with_a_gap_or_without_input_gives_numbers_or_a_sentence(case: str) -> None:
    """A gap longer than the samples that give a free run its initial position; an input that is zero throughout."""
    chain, rng = PLANTS["plain"][0], np.random.default_rng(41)
    u = Sweep(12.0, 7.0, jitter=0.4, shrink=0.4).generate(700, TS, rng)
    y = chain.simulate(theta_of(chain, {"motor.x0": 0.45}), u) + NOISE * rng.normal(size=700)
    if case == "no input":
        with pytest.raises(InputError, match=r"[a-z]"):
            fit_joint(IOData(0.0 * u, NOISE * rng.normal(size=700), TS))
        return
    missing = np.zeros((700, 1), dtype=bool)
    missing[slice(0, 60) if case == "gap at first" else slice(345, 405)] = True
    joint = fit_joint(IOData(u, y, TS, missing=missing))
    json.dumps(joint.as_dict(), allow_nan=False)
    assert joint.fit.criteria.mse == pytest.approx(NOISE**2, rel=0.3)
    assert np.isfinite(joint.unseen_percent)


@pytest.mark.nightly
def test_a_backlash_that_hardly_changes_the_fit_is_not_shown() -> None:
    """Joints without backlash whose posterior at a local optimum is far from zero: a search without it is as good."""
    chain, shown_widths = PLANTS["stribeck"][0], []
    for seed in range(4):
        rng = np.random.default_rng([seed, 43])
        u = Sweep(12.0, 7.0, jitter=0.4, shrink=0.4).generate(800, TS, rng)
        y = chain.simulate(theta_of(chain, STRIBECK | {"motor.x0": 0.45}), u)
        joint = fit_joint(IOData(u, y + NOISE * rng.normal(size=800), TS), seed=seed)
        shown_widths.append("play.width" in joint.shown)
    assert sum(shown_widths) <= 1, shown_widths
