"""A saved model reads another file of the same columns without being told which they are."""

import json
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import sysid
from sysid.channels.mapping import Range
from sysid.report import saved_models_answer
from sysid.report.saved_models_answer import of_run, word
from sysid.workflow.design import Proposal
from sysid.workflow.model_run import run_file
from sysid.workflow.record import read_record
from sysid.workflow.saved import UNFIT, Reading
from twin.cli import main

NAMES = {  # header, and the columns as options: names that say no role, or say one twice
    "one": ("time [s],pressure [bar],heater [%],temperature [degC]", "heater [%]", "temperature [degC]"),
    "two": ("time [s],valve [V],pump [V],level [cm]", "valve [V],pump [V]", "level [cm]"),
}


def write(path, head, seed):
    """A lag under both columns, of which the first is weak where the model leaves it out."""
    rng = np.random.default_rng(seed)
    u, y = np.repeat(rng.uniform(1.0, 9.0, (120, 2)), 5, axis=0), np.zeros(600)
    for t in range(1, 600):
        y[t] = 0.9 * y[t - 1] + u[t - 1] @ ([0.0, 0.2] if "heater" in head else [0.1, 0.2])
    y += 0.02 * rng.standard_normal(600) + 20.0
    rows = np.column_stack([np.arange(600.0), u, y]).tolist()
    path.write_text("\n".join([head, *(",".join(map(repr, row)) for row in rows)]) + "\n")


@pytest.mark.parametrize("case", NAMES)
def test_the_step_that_identify_names_runs_on_a_second_file(case, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    head, u, y = NAMES[case]
    write(tmp_path / "first.csv", head, 0)
    write(tmp_path / "second.csv", head, 1)
    setting = ["--structure", "output_error", "--orders", "1,1,1"]
    assert main(["identify", "first.csv", "--input", u, "--output", y, *setting, "--out", "fit"]) == 0
    printed = capsys.readouterr().out
    step = next(line for line in printed.splitlines() if "qpal run" in line)
    words = shlex.split(step[step.index("qpal run") :].replace("FILE", "second.csv"))[1:]
    assert main([*words, "--out", "run", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["read"]["input"], found["read"]["output"]) == (u, y)
    assert found["fit_percent"]["free_run"] > 95.0
    document = json.loads((tmp_path / "fit" / "model.json").read_text())
    (tmp_path / "other.json").write_text(json.dumps(document))
    assert main(["run", "fit/model.json", "other.json", "second.csv", "--json", "--out", "both"]) == 0
    assert json.loads(capsys.readouterr().out)["models"][1]["fit_percent"] == found["fit_percent"]["free_run"]
    if case == "one":  # a file of an earlier version holds the names alone
        del document["origin"]["inputs"], document["origin"]["outputs"]
        (tmp_path / "old.json").write_text(json.dumps(document))
        assert main(["run", "old.json", "second.csv", "--json", "--out", "old"]) == 0
        assert json.loads(capsys.readouterr().out)["read"]["input"] == u


def test_what_is_named_wins(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    head, u, y = NAMES["one"]
    write(tmp_path / "first.csv", head, 0)
    setting = ["--structure", "output_error", "--orders", "1,1,1", "--out", "fit"]
    assert main(["identify", "first.csv", "--input", u, "--output", y, *setting]) == 0
    swapped = ["--input", "pressure [bar]", "--output", y]
    capsys.readouterr()
    assert main(["run", "fit/model.json", "first.csv", *swapped, "--out", "run"]) == 2
    assert "the input is in" in capsys.readouterr().err


def test_what_is_left_of_two_inputs_is_tested(tmp_path):
    """By the input of which it is least independent: here the second, whose gain is halved."""
    head, u, y = NAMES["two"]
    write(tmp_path / "first.csv", head, 0)
    data = read_record(tmp_path / "first.csv", u, y).data
    fit = sysid.fit(sysid.structures.output_error(nb=1, nf=1, nk=1, nu=2, offset="free"), data)
    halved = np.where(np.array(fit.model.names) == "linear.1,2.b0", 0.5, 1.0)
    wrong = replace(fit, theta=fit.theta * halved, warnings=(f"{UNFIT}the free run misses the validation data",))
    for model, is_independent in ((wrong, False), (fit, True)):
        path = model.save(tmp_path / "model.json")
        run = run_file(str(path), Reading(str(tmp_path / "first.csv"), u, y))
        assert run.tests is not None
        assert run.tests.independent == is_independent
        assert (run.next is None) == is_independent
        if run.next is not None:  # its structure failed on its own record, and a search takes one input
            assert run.next.command.endswith("--structure state_space")
    short = run_file(str(path), Reading(str(tmp_path / "first.csv"), u, y, range=Range(stop=90.0)))
    assert short.tests is None
    assert "too few for lags" in of_run(short).sentence  # the true reason, not another


def test_the_step_of_a_design_reads_the_new_record_as_the_first():
    record = SimpleNamespace(path=Path("a.csv"), options=("--output", "the angle", "--range", "2:"))
    proposal = Proposal(record, None, SimpleNamespace(use=None))
    assert proposal.command == "qpal identify RECORDED.csv --output 'the angle' --structure actuated_joint"


@pytest.mark.parametrize(
    ("percent", "is_independent", "warnings", "said"),
    [
        (95.0, True, (), "good"),
        (95.0, False, (), "usable"),
        (99.8, False, (), "good"),  # all that is left is close to nothing
        (95.0, True, (f"{UNFIT}the gain has the WRONG SIGN",), "usable"),
    ],
)
def test_a_run_is_called_good_by_the_rule_of_identify(percent, is_independent, warnings, said, monkeypatch):
    for name in ("constant", "unexplained"):  # of what is left beside the noise of a reading
        monkeypatch.setattr(saved_models_answer, name, lambda result: "")
    model = SimpleNamespace(estimation=96.0, fit=SimpleNamespace(warnings=warnings))
    tests = SimpleNamespace(white=False, independent=is_independent)
    assert (
        word(SimpleNamespace(next=None, judged_fit=percent, growth=None, percent=percent, tests=tests, model=model))
        == said
    )
