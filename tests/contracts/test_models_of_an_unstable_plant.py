"""Several models of a plant that does not settle: ranked by predictions, and said so."""

import re

import numpy as np
import pytest

import sysid
from sysid import IOData
from sysid.report.saved_models import models_page, models_sentences
from sysid.report.saved_models_parts import overlay_figure
from sysid.workflow.model_run import run_models
from sysid.workflow.saved import Reading


def loop(seed: int, grows: float = 1.05) -> IOData:
    """A plant with one pole, which a controller holds; the log of a goal that goes up and down."""
    rng = np.random.default_rng(seed)
    goal, u, y, x = np.repeat(rng.uniform(-1.0, 1.0, 40), 25), np.zeros(1000), np.zeros(1000), 0.0
    for t in range(1000):
        y[t] = x + 0.02 * rng.normal()
        u[t] = 0.6 * (goal[t] - y[t])
        x = grows * x + 0.5 * u[t] + 0.02 * rng.normal()
    return IOData(u, y, 0.1)


@pytest.fixture(scope="module")
def ranked(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    data, other = loop(1), loop(2)
    structures = {
        "late": sysid.structures.armax(1, 1, nk=8),
        "right": sysid.structures.armax(1, 1, nk=1),
        "no_estimator": sysid.structures.output_error(1, 1, 1),
    }
    for name, model in structures.items():
        sysid.fit(model, data, starts=1).save(folder / f"{name}.json")
    np.savetxt(folder / "log.csv", np.column_stack([other.u, other.y]), "%.9g", ",", header="u,y", comments="")
    paths = [str(folder / f"{name}.json") for name in structures]
    return run_models(paths, Reading(str(folder / "log.csv"), input="u", output="y", Ts=0.1)), other


def test_the_model_that_predicts_best_is_first_though_no_free_run_follows(ranked):
    result, other = ranked
    assert max(run.percent for run in result.runs) < 50.0
    assert result.best.model.name == "right"
    horizons = {run.growth.horizon for run in result.runs}
    assert len(horizons) == 1
    (k,) = horizons
    fit, n = result.best.model.fit, result.best.n_init
    y, predicted = other.y[n:, 0], np.ravel(fit.predict(other, k))[n:]
    expected = 100.0 * (1.0 - np.linalg.norm(y - predicted) / np.linalg.norm(y - y.mean()))
    assert result.best.judged_fit == pytest.approx(expected, abs=1e-3)
    assert result.best.judged_fit > 60.0 > result.runs[-1].judged_fit
    assert [run.judged_fit for run in result.runs] == sorted((run.judged_fit for run in result.runs), reverse=True)


def test_every_part_says_that_it_is_a_prediction(ranked):
    result, _ = ranked
    k = result.best.growth.horizon
    judged = f"prediction {k} steps ahead" if k > 1 else "prediction one step ahead"
    page, shown = models_page(result), f"{result.best.judged_fit:.2f} %"
    assert page.answer.number == shown
    assert page.answer.of == f"of the record explained by the {judged} of right, the best of 3 models"
    assert page.answer.values.headings[-1] == f"this record, {judged}"
    (said, *_) = models_sentences(result)
    assert said == f"right follows the record best: {shown} in {judged}, as no free run follows it."
    measured, best, *_ = overlay_figure(result).panels[0].lines()
    names = [line.label for line in (measured, best)]
    assert f"right, fit {shown}" in names
    np.testing.assert_array_equal(best.y, result.best.ahead.output[:, 0])
    assert not re.search("free run, fit|in free run", " ".join([*names, *page.verdict]))


def test_models_of_a_plant_that_settles_are_ranked_by_free_runs(tmp_path):
    """Also beside one that predicts, and does not settle itself."""
    rng = np.random.default_rng(4)
    u, y = np.repeat(rng.uniform(-1.0, 1.0, 60), 10), np.zeros(600)
    for t in range(1, 600):
        y[t] = 0.9 * y[t - 1] + u[t - 1]
    y += 0.1 * rng.normal(size=600)
    settles = sysid.fit(sysid.structures.output_error(1, 1, 1), IOData(u, y, 0.1), starts=1)
    settles.save(tmp_path / "settles.json")
    sysid.fit(sysid.structures.armax(1, 1, 1), loop(1), starts=1).save(tmp_path / "grows.json")
    np.savetxt(tmp_path / "log.csv", np.column_stack([u, y]), "%.9g", ",", header="u,y", comments="")
    reading = Reading(str(tmp_path / "log.csv"), input="u", output="y", Ts=0.1)
    result = run_models([str(tmp_path / "grows.json"), str(tmp_path / "settles.json")], reading)
    assert result.best.model.name == "settles"
    assert all(run.growth is None for run in result.runs)
    assert models_page(result).answer.values.headings[-1] == "this record"
