"""Sentences of reports: names as they are written, units as the figures have them, sentences that end."""

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.diagnosis.advice import advise
from sysid.workflow import design as design_of
from sysid.workflow.remarks import extrapolated_signals, gain_remarks
from twin.cli import recipes
from twin.compare.comparison import MODEL, TWIN
from twin.report import calibrate, compare, simulate


@pytest.mark.parametrize(
    ("kind", "label", "first"), [(MODEL, "model.json", "model.json"), (TWIN, "the twin", "The twin")]
)
def test_the_name_of_a_file_stays_as_it_is(kind, label, first):
    regime = SimpleNamespace(of_error=0.6, share=0.5, name="fast")
    empty = {"alignment": None, "verdict": None, "outliers": ()}
    result = SimpleNamespace(kind=kind, label=label, regimes=(regime,), rms=0.1, fit=90.0, noise=0.01, **empty)
    assert compare.sentences(result, "log.csv")[0].startswith(f"{first} follows the log")


@pytest.mark.parametrize(
    ("late", "converged", "words"),
    [
        (True, True, "The search made 3 iterations: it ended."),
        (True, False, "The search made 3 iterations: it ended."),
        (False, True, "The search converged after 3 iterations."),
        (False, False, "The search did not converge after 3 iterations: it ended."),
    ],
)
def test_a_search_that_was_stopped_did_not_converge_in_the_same_sentence(late, converged, words, monkeypatch):
    monkeypatch.setattr(calibrate.advice, "sentences", lambda result: [])
    found = SimpleNamespace(late=late, stop=SimpleNamespace(iterations=3), descents=1)
    ended = {"converged": converged, "reason": "it ended", "scores": (), "next_step": lambda: ""}
    result = SimpleNamespace(found=found, agreements=(), differing=[], **ended)
    assert calibrate.search_sentence(result) == words
    is_fine = converged and not late  # then its words are the last of the page alone
    assert calibrate.sentences(result) == ([] if is_fine else [words])


@pytest.mark.parametrize(
    ("switches", "words"),
    [([], "thigh, with every imperfection."), (["noise", "delay"], "thigh, without noise, delay.")],
)
def test_a_record_says_which_imperfections_it_has(switches, words):
    data = IOData(np.arange(9.0), np.arange(9.0), 0.1, "voltage", "angle", "V", "rad")
    part = SimpleNamespace(joint="thigh", data=data, y_true=data.y[:, 0])
    assert simulate._pictures(part, "voltage", switches)[0].caption.endswith(words)


def test_a_structure_may_be_named_as_tables_print_it():
    assert recipes.recipe("actuated-joint", {}).name == "actuated_joint"
    with pytest.raises(InputError, match=r"unknown structure 'joint'; choose one of .*wiener_hammerstein, auto$"):
        recipes.recipe("joint", {})


def parts(u_unit, y_unit):
    u, y = np.linspace(-1.0, 1.0, 200), np.linspace(0.0, 1.0, 200)
    one = IOData(u, y, 0.1, "speed", "angle", u_unit, y_unit)
    return one, IOData(2 * u, 2 * y, 0.1, "speed", "angle", u_unit, y_unit)


def test_ranges_have_the_units_of_figures():
    pure, angle = extrapolated_signals(*parts("1", "rad"))
    assert pure.startswith("speed was seen from -1 to 1 and goes from -2 to 2 in the validation data (")
    assert angle.startswith("angle was seen from 0 to 57.3 deg and goes from 0 to 114.6 deg in")


def test_advice_has_the_units_of_figures():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-3, 3, 100), 20)
    y = np.clip(np.cumsum(0.02 * u), -0.5, 0.5)
    y = np.round(y / 0.01) * 0.01
    said = {a.topic: a.sentence for a in advise(IOData(u, y, 0.1, "u", "angle", "V", "rad"))}
    assert "moves in steps of 0.573 deg" in said["resolution"]
    assert "alone is noise of 0.165 deg" in said["resolution"]
    assert "(28.65 deg)" in said["rest"]


def test_a_gain_has_the_unit_of_figures():
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-3, 3, 60), 20)
    y = np.zeros(len(u))
    for t in range(1, len(u)):
        y[t] = 0.9 * y[t - 1] + 0.1 * u[t - 1]
    data = IOData(u, y, 0.1, "voltage", "angle", "V", "rad")
    (said,) = gain_remarks(data, data, y, np.array([-0.1, -0.5]))
    assert "mean input, -28.6 deg/V, has the WRONG SIGN" in said


def test_a_log_of_no_joint_is_told_in_whole_sentences(monkeypatch):
    said = SimpleNamespace(
        joint=False, undetermined=False, sentence=lambda: "This record does not show it. Record again."
    )
    data = SimpleNamespace(Ts=0.1, y_unit="rad")
    monkeypatch.setattr(
        design_of, "read_record", lambda path, **columns: SimpleNamespace(data=data, options=("--output", "the angle"))
    )
    monkeypatch.setattr(design_of.ActuatedJoint, "scale", lambda self, data: data)
    monkeypatch.setattr(design_of, "fit_joint", lambda data, **options: SimpleNamespace(stopped="", fit=None))
    monkeypatch.setattr(design_of, "verdict", lambda joint, data: said)
    with pytest.raises(InputError) as error:
        design_of.propose("a.csv", ())
    assert str(error.value) == (
        "This record does not show it. Record again. No experiment is designed from it. To see the fit: qpal identify "
        "a.csv --output 'the angle' --structure actuated_joint"
    )
