"""Sizes that no machine holds are refused before the work begins, in calls and in saved models."""

import json
from pathlib import Path

import numpy as np
import pytest

import sysid
import twin
from sysid import InputError
from sysid.excitations import Aprbs, Chirp, Multisine, Prbs, Staircase, Steps, Sweep

SAVED = json.loads((Path(__file__).parents[1] / "saved" / "v1" / "fixed_bounds.json").read_text(encoding="utf-8"))
SIGNALS = {
    "half period of a nanosecond": lambda: Sweep(half_period=1e-9),
    "half period": lambda: Sweep(half_period=1e308),
    "hold of a prbs": lambda: Prbs(hold=1e308),
    "hold of steps": lambda: Steps(hold=1e308),
    "rest of steps": lambda: Steps(rest=1e308),
    "hold of a staircase": lambda: Staircase(hold=1e308),
    "hold_max": lambda: Aprbs(hold_max=1e308),
    "amplitude": lambda: Aprbs(amplitude=1e308),
    "period of a chirp": lambda: Chirp(period=1e11),
    "period of a multisine": lambda: Multisine(period=1e11),
}


@pytest.mark.parametrize("make", SIGNALS.values(), ids=SIGNALS)
def test_a_signal_of_no_possible_length_is_refused(make):
    with pytest.raises(InputError, match=r"give a (number up|time of at most)"):
        make().generate(100, 0.1, np.random.default_rng(0))


def test_a_record_is_no_longer_than_its_simulation_may_be():
    with pytest.raises(InputError, match=r"duration is 1e\+09 s; give at most 1e\+06 s"):
        twin.Experiment(duration=1e9)
    with pytest.raises(InputError, match="N is 1000000000; give a whole number up to"):
        Aprbs().generate(10**9, 0.1, np.random.default_rng(0))
    assert twin.Experiment(duration=604800.0).N == 6048000  # a week is fine


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (("model", "fixed"), None, "fixed"),
        (("model", "fixed"), {"linear.f1": None}, "linear.f1 is fixed at None"),
        (("model", "fixed"), {"linear.f1": "x"}, "linear.f1 is fixed at 'x'"),
        (("model", "blocks", 0, "units"), 10**9, "units is 10+; give a whole number up to 10,000"),
        (("model", "blocks", 1, "nb"), 10**9, "nb is 10+; give a number up to 1,000"),
        (("model", "blocks", 1, "nk"), 10**9, "nk is 10+; give a number up to 100,000"),
        (("model", "blocks", 2, "degree"), 10**9, "degree is 10+; give a whole number up to 10,000"),
        (("Ts",), 1e308, "Ts is 1e"),
        (("n_init",), 10**400, "n_init 10+"),
    ],
)
def test_an_entry_of_a_saved_model_has_its_limit(place, value, words, tmp_path):
    document = json.loads(json.dumps(SAVED))
    at = document
    for key in place[:-1]:
        at = at[key]
    at[place[-1]] = value
    path = tmp_path / "model.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match=rf"model\.json: .*{words}"):
        sysid.load(path)
