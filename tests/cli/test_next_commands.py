"""A refusal of a saved model names what is wrong first, and the command that is then accepted."""

import shlex

import numpy as np
import pytest

from twin.cli import main


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    u = np.repeat(np.random.default_rng(0).uniform(1.0, 3.0, 30), 10)
    y = np.zeros(300)
    for t in range(1, 300):
        y[t] = 0.8 * y[t - 1] + 0.2 * u[t - 1]
    rows = np.column_stack([0.1 * np.arange(300), u, y])
    np.savetxt("log.csv", rows, delimiter=",", header="time_s,u,y", comments="")
    for name in ("a", "b"):
        assert main(["identify", "log.csv", "--structure", "output_error", "--starts", "1", "--out", name]) == 0
    return tmp_path


def test_a_log_before_the_models_is_told_with_the_command_that_works(here, capsys):
    for given in (["run", "log.csv", "a/model.json"], ["run", "log.csv", "a/model.json", "b/model.json"]):
        capsys.readouterr()
        assert main(given) == 2
        meant = capsys.readouterr().err.strip().rpartition("the models: ")[2]
        assert main([*shlex.split(meant)[1:], "--out", "again"]) == 0


def test_a_model_without_a_motor_is_not_sent_to_another_detrend(here, capsys):
    capsys.readouterr()
    assert main(["export", "a/model.json", "--mjcf"]) == 2
    said = capsys.readouterr().err
    assert "has no motor" in said
    assert "--detrend" not in said
