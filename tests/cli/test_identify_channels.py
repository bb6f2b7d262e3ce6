"""`qpal identify` with several inputs and outputs: a known plant of two of each, and who refuses it."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.structures import Hammerstein, NonlinearStateSpace, OutputError
from sysid.workflow.identification import identify_file
from sysid.workflow.results import single_channels
from sysid.workflow.setting import Setting
from twin.cli import main

GAINS = np.array([[0.5, 0.2], [-0.3, 0.4]])
POLES = np.array([[0.8, 0.5], [0.6, 0.9]])
NAMES = ["--input", "a,b", "--output", "c,d"]


@pytest.fixture
def square(tmp_path, monkeypatch):
    """two.csv: y_j = sum of GAINS / (z - POLES) u_i, with offsets and a little noise; u_1 is squared in bent.csv."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-1.0, 1.0, (60, 2)), 5, axis=0)
    for name, w in (("two", u), ("bent", np.column_stack([u[:, 0] + u[:, 0] ** 2, u[:, 1]]))):
        shares = [[lfilter([0.0, GAINS[j, i]], [1.0, -POLES[j, i]], w[:, i]) for i in range(2)] for j in range(2)]
        y = np.sum(shares, axis=1).T + 0.01 * rng.normal(size=(300, 2))
        rows = np.column_stack([0.1 * np.arange(300), u, y + np.array([3.0, -2.0])])
        lines = [",".join(map(repr, row)) for row in rows.tolist()]
        (tmp_path / f"{name}.csv").write_text("\n".join(["t [s],a,b,c,d", *lines]) + "\n")
    return tmp_path


def test_a_plant_of_two_inputs_and_outputs_is_recovered(square, capsys):
    line = ["two.csv", *NAMES, "--structure", "output_error", "--orders", "1,1,1", "--starts", "1"]
    assert main(["identify", *line, "--out", "o"]) == 0
    shown = capsys.readouterr().out
    summary = json.loads((square / "o" / "summary.json").read_text())
    values = {p["name"]: p["value"] for p in summary["parameters"]}
    for j in range(2):
        for i in range(2):
            assert values[f"linear.{j + 1},{i + 1}.b0"] == pytest.approx(GAINS[j, i], abs=0.02)
            assert values[f"linear.{j + 1},{i + 1}.f1"] == pytest.approx(-POLES[j, i], abs=0.03)
    fits = summary["fit_percent"]
    assert set(fits["outputs"]) == {"c", "d"}
    for part in ("estimation", "validation"):
        assert fits[part] == pytest.approx(np.mean([fits["outputs"][name][part] for name in "cd"]))
        assert fits[part] > 98.0  # noise alone leaves 1 %
    assert [channel["column"] for channel in summary["read"]["channels"]] == ["a", "b", "c", "d"]
    assert {path.name for path in (square / "o" / "figures").iterdir()} >= {"free-run-1.png", "free-run-2.png"}
    assert (square / "o" / "model.json").exists()
    page = (square / "o" / "report.html").read_text()
    for name in "cd":
        assert f"the same of {name}, validation data" in shown
        assert f"Output {name}. Measured output" in page
    assert "Input a, output c. " in page
    source = (square / "o" / "model.py").read_text()
    scope = {"__name__": "model"}
    exec(source, scope)
    rest = [values[f"offset.{j}.y0"] for j in (1, 2)]
    assert rest == pytest.approx([3.0, -2.0], abs=0.02)
    assert scope["simulate"]([[0.0, 0.0]])[0] == pytest.approx(rest)  # each has its offset


def test_each_output_has_its_runs_tests_and_figures(square):
    e = identify_file("two.csv", Setting(OutputError(1, 1, 1), starts=1), "a,b", "c,d").evaluation
    assert e.validation_output.shape == (150, 2)
    assert [(mark, one.estimation.u_name, one.estimation.y_name) for mark, _, one in single_channels(e, "Data")] == [
        ("-1", "a", "c"),
        ("-2", "b", "d"),
    ]
    for j, (_, _, one) in enumerate(single_channels(e, "Model output")):
        assert np.array_equal(one.validation.y[:, 0], e.validation.y[:, j])
        assert np.array_equal(one.validation_output, e.validation_output[:, j])
        assert one.validation_fit == e.outputs[j].validation_fit
        error = one.validation.y[:, 0] - one.validation_output
        y = one.validation.y[:, 0]
        n = e.fit.n_init
        want = 100 * (1 - np.linalg.norm(error[n:]) / np.linalg.norm(y[n:] - y[n:].mean()))
        assert one.validation_fit == pytest.approx(want)
    p = [output.tests.independence_p for output in e.outputs]
    assert e.tests.independence_p == min(p)
    assert single_channels(e, "Model") == [("", "", e)]


def test_two_inputs_drive_one_output_and_maps_stand_side_by_side(square):
    recipe = Hammerstein(1, 1, 1, "polynomial")
    e = identify_file("bent.csv", Setting(recipe, starts=1), "a,b", "c").evaluation
    linear = identify_file("bent.csv", Setting(OutputError(1, 1, 1), starts=1), "a,b", "c").evaluation
    assert e.validation_fit > 97.0 > 85.0 > linear.validation_fit
    assert list(e.maps) == ["input 1", "input 2"]
    curve = e.maps["input 1"]
    bend = np.polyfit(curve.x, curve.y, 3)
    assert abs(bend[1] / bend[2]) > 0.5  # a + a^2, seen from its mean
    assert len(e.outputs) == 1


def test_a_state_space_of_two_inputs_and_outputs(square):
    recipe = NonlinearStateSpace(4, 0, 0, readout="linear")
    e = identify_file("two.csv", Setting(recipe, "lm", starts=1), "a,b", "c,d", split=0.8).evaluation
    assert min(output.validation_fit for output in e.outputs) > 90.0


@pytest.mark.parametrize("structure", ["actuated_joint", "nlarx", "wiener_hammerstein", "coupled_drives", "auto"])
def test_who_takes_one_of_each_names_who_takes_more(structure, square, capsys):
    assert main(["identify", "two.csv", *NAMES, "--structure", structure]) == 2
    said = capsys.readouterr().err
    assert "one input and one output, and the record has 2 and 2" in said
    assert "--structure hammerstein, hammerstein_wiener, output_error, state_space or wiener" in said


def test_columns_by_name(square, capsys):
    table = (square / "two.csv").read_text().replace("t [s],a,b,c,d", 't [s],"a,b",e,c,d')
    (square / "comma.csv").write_text(table)
    one = identify_file("comma.csv", Setting(OutputError(1, 1, 1), starts=1), "a,b", "c")
    assert one.record.input == "a,b"
    assert one.record.data.u.shape[1] == 1  # a column of that name
    for given, found in ((["a,a"], "name one twice"), (["a,x"], "unknown column 'x'"), ([","], "give each once")):
        assert main(["identify", "two.csv", "--input", *given, "--output", "c"]) == 2
        assert found in capsys.readouterr().err
