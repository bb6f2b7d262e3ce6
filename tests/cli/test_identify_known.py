"""`qpal identify` with what is known before: held and bounded parameters, saved fits, the zero of a record."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import sysid
from sysid.data.trends import steady_level
from sysid.structures import HammersteinWiener, OutputError, Wiener
from sysid.workflow.changes import command
from sysid.workflow.identification import identify_file
from sysid.workflow.record import read_record
from sysid.workflow.setting import Held, Setting, read_start, settings_of
from twin.cli import main

TRUE = {"linear.b0": 0.5, "linear.b1": 0.2, "linear.f1": -1.5, "linear.f2": 0.54}
OE = OutputError(2, 2, 1)
RAW = {"detrend": "none"}


@pytest.fixture
def logs(tmp_path, monkeypatch):
    """plain.csv: the plant TRUE with noise; bent.csv: it behind tanh; rest.csv: it at rest at 4 and 7 first."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(6)
    u = np.repeat(rng.uniform(-1.0, 1.0, 60), 5)
    y = lfilter([0.0, 0.5, 0.2], [1.0, -1.5, 0.54], u)
    still = np.r_[np.zeros(20), np.abs(u)]
    at_rest = lfilter([0.0, 0.5, 0.2], [1.0, -1.5, 0.54], still)
    for name, a, b in (
        ("plain", u, y + 0.2 * rng.normal(size=300)),
        ("bent", u, np.tanh(0.5 * y) + 0.005 * rng.normal(size=300)),
        ("rest", still + 4.0, at_rest + 7.0 + 0.02 * rng.normal(size=320)),
    ):
        rows = np.column_stack([0.1 * np.arange(len(a)), a, b]).tolist()
        (tmp_path / f"{name}.csv").write_text("t [s],u,y\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows))
    return tmp_path


def identified(name, recipe=OE, held=Held(), **options):  # noqa: B008
    return identify_file(f"{name}.csv", Setting(recipe, starts=1, held=held), **options)


def parameters(result):
    return {p.name: p for p in result.evaluation.fit.parameters}


def refused(line, capsys):
    assert main(["identify", *shlex.split(line)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def test_a_true_parameter_that_is_held_is_exact_and_improves_the_others(logs, capsys):
    line = "plain.csv --structure output_error --orders 2,2,1 --starts 1 --offset none --fix linear.f1=-1.5 "
    assert main(["identify", *shlex.split(line + "--fix linear.f2=0.54 --json --out o")]) == 0
    summary = json.loads(capsys.readouterr().out)
    held = {p["name"]: p for p in summary["parameters"]}
    free = parameters(identified("plain", **RAW))
    assert [p["re"] for p in summary["poles"]] == pytest.approx([0.9, 0.6], abs=1e-12)
    assert Path("o/report.html").read_text(encoding="utf-8").count(">fixed</td>") == 6  # 2 parameters, 2 poles
    assert summary["setting"]["fixed"] == {"linear.f1": -1.5, "linear.f2": 0.54}
    assert (held["linear.f1"]["free"], held["linear.f1"]["std"]) == (False, None)
    for name in ("linear.b0", "linear.b1"):
        assert held[name]["std"] < 0.8 * free[name].std
        assert abs(held[name]["value"] - TRUE[name]) < 3 * held[name]["std"]
    assert summary["criteria"]["d"] == 4  # b0, b1 and the initial state, with --offset none


def test_a_bound_holds_and_is_reached_where_the_optimum_is_beyond_it(logs):
    bound = Held(bounds=(("linear.b0", (0.6, np.inf)), ("linear.f2", (0.0, 1.0))))
    found = parameters(identified("plain", held=bound, **RAW))
    assert found["linear.b0"].value == pytest.approx(0.6, abs=1e-9)
    assert (found["linear.b0"].lower, found["linear.f2"].upper) == (0.6, 1.0)
    assert parameters(identified("plain", **RAW))["linear.b0"].value < 0.59


def test_maps_around_a_saved_linear_model_reach_its_fit_and_more(logs, capsys):
    linear = identified("bent", **RAW)
    linear.evaluation.fit.save("linear.json")
    line = "bent.csv --structure hammerstein_wiener --input-map unit_gain --detrend none --json --out o"
    assert main(["identify", *shlex.split(line), "--from", "linear.json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["setting"]["orders"] == {"nb": 2, "nf": 2, "nk": 1}  # those of the saved filter
    assert (summary["setting"]["from"], summary["setting"]["starts"]) == ("linear.json", 1)
    assert summary["fit_percent"]["estimation"] > 98.0
    assert linear.evaluation.estimation_fit < 90.0


@pytest.mark.parametrize("maps", ["piecewise_linear", "cubic_spline", "sigmoid_network", "polynomial"])
def test_the_maps_start_straight(logs, maps):
    """Before any iteration the model with maps is the linear one."""
    fit = identified("bent", **RAW).evaluation.fit
    data = read_record("bent.csv").data
    chain, theta = Held(start=fit).apply(HammersteinWiener(2, 2, 1, maps, maps).model(), data)
    np.testing.assert_allclose(chain.outputs(theta, data.u), fit.model.outputs(fit.theta, data.u), atol=1e-8)


def test_a_saved_fit_continues_and_a_whole_block_keeps_its_values(logs):
    first = identified("bent", Wiener(2, 2, 1), **RAW).evaluation.fit
    first.save("wiener.json")
    saved = read_start("wiener.json")
    assert settings_of(saved, Wiener) == {"nb": 2, "nf": 2, "nk": 1, "output_map": "piecewise_linear"}
    again = identified("bent", Wiener(2, 2, 1), Held(start=saved), **RAW).evaluation.fit
    assert again.stop.iterations < 0.5 * first.stop.iterations  # it begins at the end of the first, beside a kink
    assert 0.95 * first.criteria.fpe < again.criteria.fpe < 1.01 * first.criteria.fpe  # a prior stands beside the loss
    held = identified("plain", Wiener(2, 2, 1), Held((("linear", None),), start=saved), **RAW).evaluation.fit
    part = held.model.index(held.model.blocks[0])
    own = ~held.model.initial[part]
    assert np.array_equal(held.theta[part][own], first.theta[part][own])
    assert held.model.free[part][~own].all()  # the initial state is the record's
    assert held.model.free[part.stop :].all()


def test_a_start_that_does_not_fit_is_refused(logs, capsys):
    identified("plain", **RAW).evaluation.fit.save("linear.json")
    sysid.fit(sysid.structures.nlarx(2, 2, 1, units=4), read_record("bent.csv").data, starts=1).save("narx.json")
    assert "filters of nb,nf,nk 2,2,1" in refused("plain.csv --from linear.json --orders 2,3,1", capsys)
    assert "--starts and --from" in refused("plain.csv --from linear.json --starts 3", capsys)
    assert "cannot start a fit" in refused("plain.csv --from narx.json", capsys)
    assert "--resample 0.1" in refused("plain.csv --from linear.json --resample 0.2", capsys)
    assert "name a structure" in refused("plain.csv --from linear.json --structure auto", capsys)
    assert "nowhere.json" in refused("plain.csv --from nowhere.json", capsys)
    assert "nonlinear ARX" in refused("plain.csv --structure nlarx --fix linear.f1=1", capsys)


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ("--fix linear.f9=1", "it has linear.b0, linear.b1, linear.f1, linear.f2, linear.x0_0"),
        ("--bound sensor.k=0:1", "--bound names 'sensor.k', which the model does not have; it has linear.b0"),
        ("--fix linear.f1", "give linear.f1=VALUE, or a start with --from"),
        ("--fix linear", "give linear.b0=VALUE, or a start with --from"),
        ("--fix linear=2", "names a whole block"),
        ("--fix linear.f1=fast", "give role.name=VALUE"),
        ("--fix linear.f1=1 --fix linear.f1=2", "names linear.f1 twice"),
        ("--bound linear.f1=1", "give role.name=LOW:HIGH"),
        ("--bound linear.f1=2:1", "the smaller first"),
        ("--bound linear.f1=0:1 --fix linear.f1=3", "held at 3, and it lies between 0 and 1"),
        ("--fix linear.f1=-1.99 --fix linear.f2=1.2", "no start is a valid model"),
        ("--zero steady", "the input moves at sample 5"),
        ("--zero steady --detrend linear", "--detrend is linear and --zero is steady"),
        ("--zero low", "mean, steady"),
    ],
)
def test_what_cannot_be_held_is_told_with_what_can(logs, capsys, given, found):
    line = f"plain.csv --structure output_error --orders 2,2,1 --starts 1 {given}"
    said = refused(line, capsys)
    assert found in said


def test_the_level_at_rest_is_the_zero_of_a_record_that_begins_there(logs):
    steady = identified("rest", detrend="steady")
    mean = identified("rest", OutputError(2, 2, 1, offset="none"), detrend="mean")
    data = read_record("rest.csv").data
    u, y = steady_level(data)
    assert (u[0], y[0]) == (4.0, pytest.approx(7.0, abs=0.02))
    e = steady.evaluation
    assert (e.estimation.u_offset, e.estimation.y_offset) == (u, y)
    assert np.array_equal(np.concatenate([e.estimation.y, e.validation.y]), data.y - y)
    for name, true in TRUE.items():
        assert parameters(steady)[name].value == pytest.approx(true, abs=0.02)
    assert e.validation_fit > 98.0 > mean.evaluation.validation_fit
    assert "--detrend steady" in command(steady)


def test_the_next_command_keeps_what_is_held(logs):
    identified("plain", **RAW).evaluation.fit.save("linear.json")
    held = Held((("linear.f1", -1.5),), (("linear.b0", (0.1, np.inf)),), *_start("linear.json"))
    words = command(identified("plain", held=held, **RAW))
    assert "--from linear.json --fix linear.f1=-1.5 --bound linear.b0=0.1:" in words
    assert "--starts" not in words
    anew = command(identified("plain", held=held, **RAW), nk=2)
    assert "--from" not in anew
    assert "--fix linear.f1=-1.5" in anew


def _start(path):
    from pathlib import Path

    return read_start(path), Path(path)


def test_parameters_of_a_joint_can_be_held(tmp_path):
    sysid_names = sysid.structures.actuated_joint(play=False).names
    held = Held((("motor.lag", 0.05), ("motor.load1", 0.0)))
    chain, start = held.apply(sysid.structures.actuated_joint(play=False), None)
    assert start is None
    assert chain.names == sysid_names
    assert (chain.fixed["motor.lag"], chain.fixed["motor.v0"]) == (0.05, 0.0)  # its own stay held
