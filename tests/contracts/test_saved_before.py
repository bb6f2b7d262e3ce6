"""Fits that earlier versions of the code saved: each loads, and gives the numbers that it gave then."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sysid
from sysid.estimation.initial_state import filters_only
from sysid.estimation.joint_parts import motor_of

SAVED = Path(__file__).resolve().parents[1] / "saved"
FILES = sorted(p for p in SAVED.glob("v*/*.json") if not p.name.endswith(".run.json"))
JOINTS = ("joint_jams", "joint_stribeck")


def record(of: dict) -> sysid.IOData:
    y = np.array(of["y"])
    missing = np.zeros(y.size, dtype=bool)
    missing[of.get("missing", [])] = True
    return sysid.IOData(of["u"], y, of["Ts"], missing=missing.reshape(y.shape), lengths=tuple(of["lengths"]))


def small_steps(fit: sysid.Fit) -> sysid.Fit:
    """The fit with its motor in a thousand steps a sample."""
    motor = motor_of(fit.model)
    blocks = tuple(replace(b, substeps=1000) if b is motor else b for b in fit.model.blocks)
    return replace(fit, model=replace(fit.model, blocks=blocks))


@pytest.mark.parametrize("path", FILES, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_a_fit_saved_by_earlier_code_simulates_to_the_same_numbers(path):
    then = json.loads(path.with_suffix(".run.json").read_text())
    fit, data = sysid.load(path), record(then["record"])
    span = np.ptp(data.y)
    if path.stem in JOINTS:
        # Since then a load acts in the middle of the way, and a stop is struck within a sample: nearer to the motion
        # that both come to in small steps.
        exact, now = small_steps(fit).simulate(data.u), fit.simulate(data.u)
        assert np.linalg.norm(now - exact) <= 0.1 * np.linalg.norm(then["from_rest"] - exact) + 1e-11 * span
        np.testing.assert_allclose(fit.simulate(data), then["on_record"], rtol=0, atol=5e-3 * span)
        return
    np.testing.assert_allclose(fit.simulate(data.u), then["from_rest"], rtol=0, atol=1e-12 * span)
    if fit.model.initial.any() and filters_only(fit.model):
        # Then by least squares, now the likely initial state under the fit's noise, which is no worse than rest.
        rest = np.reshape(fit.simulate(data.u), data.y.shape)
        error = [
            np.mean((data.y - np.reshape(run, data.y.shape))[fit.n_init :] ** 2) for run in (fit.simulate(data), rest)
        ]
        assert error[0] < 1.01 * error[1]
    else:
        # The search for the initial state ends in a flat bottom, where rounding moves it by about its square root.
        np.testing.assert_allclose(fit.simulate(data), then["on_record"], rtol=0, atol=1e-7 * span)
        assert fit.fit_percent(data) == pytest.approx(then["fit_percent"], abs=1e-6)
    np.testing.assert_allclose(fit.poles, np.array(then["poles"]).reshape(-1, 2) @ [1.0, 1.0j], rtol=1e-12)
    saved = json.loads(path.read_text())
    assert fit.criteria.loss == saved["criteria"]["loss"]
    assert fit.criteria.fpe == pytest.approx(saved["criteria"]["fpe"], rel=1e-12)
    np.testing.assert_array_equal(fit.theta, list(saved["theta"].values()))
    np.testing.assert_array_equal(fit.covariance.cov.shape, (len(fit.theta), len(fit.theta)))


def kinds(value) -> set[str]:
    """Kinds of block anywhere in a saved document."""
    if isinstance(value, dict):
        found = set().union(*map(kinds, value.values())) if value else set()
        return found | ({value["kind"]} if "kind" in value else set())
    return set().union(*map(kinds, value)) if isinstance(value, list) and value else set()


def test_the_first_version_is_kept_for_every_block_that_it_could_hold():
    found = set().union(*(kinds(json.loads(p.read_text())) for p in FILES if p.parent.name == "v1"))
    assert len(found) == 21  # all but the custom one: a function of one's own has no text
