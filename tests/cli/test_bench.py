"""`qpal bench` as its user meets it: a row of a method of one's own, a report, and sentences for what is wrong."""

import json

import numpy as np
import polars as pl
import pytest

from sysid.bench.table import read
from twin.cli import main


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def said(arguments, capsys, code=0):
    assert main(["bench", *arguments]) == code
    found = capsys.readouterr()
    return found.out if code == 0 else found.out + found.err


def test_from_nothing_to_a_row_of_ones_own(here, capsys):
    """The scaffold runs as it is; the command that it prints makes rows, and the report names them."""
    added = said(["add", "my_arx"], capsys)
    command = added.partition("Next: qpal ")[2].split()
    command = [word.strip("'") for word in command]
    assert main([*command, "--scenario", "drawn/output_error", "--seeds", "2"]) == 0
    assert "qpal bench report runs/my_arx.parquet" in capsys.readouterr().out
    rows = read("runs/my_arx.parquet").filter(pl.col("method") == "my_arx")
    assert set(rows["status"]) == {"ok"}
    assert rows.filter(pl.col("scenario") == "drawn/output_error")["fit"].min() > 50.0
    assert "my_arx" in said(["report", "runs/my_arx.parquet", "--out", "page"], capsys)
    assert "my_arx" in (here / "page" / "report.html").read_text(encoding="utf-8")
    assert "exists already" in said(["add", "my_arx"], capsys, 2)


def test_a_run_as_json_and_again(here, capsys):
    run = ["run", "--scenario", "drawn/wiener", "--method", "wiener", "--seeds", "2", "--workers", "1", "--json"]
    first = json.loads(said(run, capsys))
    assert (first["rows"], first["new"], first["without result"]) == (2, 2, 0)
    assert json.loads(said(run, capsys))["new"] == 0


def test_against_a_better_base_the_status_is_1(here, capsys):
    run = ["run", "--scenario", "drawn/wiener", "--method", "from_truth", "--method", "output_error", "--seeds", "12"]
    said([*run, "--out", "new.parquet", "--workers", "1"], capsys)
    rows = read("new.parquet")
    better = rows.with_columns(fit=pl.when(pl.col("method") == "output_error").then(99.9).otherwise("fit"))
    better.write_parquet("base.parquet")
    assert "Nothing got worse" in said(["report", "new.parquet", "--against", "new.parquet", "--out", "a"], capsys)
    text = said(["report", "new.parquet", "--against", "base.parquet", "--out", "b"], capsys, 1)
    assert "output_error" in text.partition("Worse: ")[2]


def test_exported_data_are_those_of_the_scenario(here, capsys):
    said(["export", "textbook/textbook", "--seed", "3", "--out", "data"], capsys)
    known = json.loads((here / "data" / "scenario.json").read_text())
    assert (known["Ts"], known["drop"]) == (0.1, 50)
    lines = (here / "data" / "train.csv").read_text().splitlines()
    assert len(lines) == 4001
    assert "not empty" in said(["export", "textbook/textbook", "--out", "data"], capsys, 2)


def test_what_had_no_chance_is_told_and_run_again(here, capsys):
    """First without the folder of the records, then with one in which the record lies."""
    run = ["run", "--scenario", "real/ced", "--method", "output_error", "--workers", "1", "--out", "t.parquet"]
    assert "nobody said where the record ced lies" in said(run, capsys)
    assert "no method of the table had a chance" in said(["report", "t.parquet"], capsys, 2)
    rng = np.random.default_rng(0)
    (here / "ced").mkdir()
    np.savetxt(here / "ced" / "DATAUNIF.csv", rng.standard_normal((500, 5)), delimiter=",", header="a,b,c,d,")
    assert "1 rows run, 1 in t.parquet, 0 of them" in said([*run, "--records", str(here)], capsys)


def test_a_method_of_ones_own_is_compared_too(here, capsys):
    said(["add", "my_arx"], capsys)
    run = ["run", "--method", "my_arx.py", "--scenario", "drawn/output_error", "--seeds", "8", "--out", "t.parquet"]
    said(run, capsys)
    worse = read("t.parquet").with_columns(pl.col("loss") * 1.5, pl.col("fit") - 5.0)
    worse.write_parquet("worse.parquet")
    assert "my_arx" in said(["report", "worse.parquet", "--against", "t.parquet", "--out", "a"], capsys, 1)
    for name in ("hammerstein", "numpy"):
        assert "is the name of a method or module" in said(["add", name], capsys, 2)


def test_the_list_names_every_family(here, capsys):
    found = json.loads(said(["list", "--json"], capsys))
    assert {"drawn", "legs", "mismatch", "real", "stress", "textbook", "twin"} <= set(found["scenarios"])
    assert {"from_truth", "auto", "jax_sysid", "forty_lines"} <= set(found["methods"])
    assert {"quick", "standard", "full"} == set(found["tags"])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run"], "--tag (quick, standard, full) or --scenario"),
        (["run", "--tag", "fast"], "unknown tag 'fast'"),
        (["run", "--scenario", "drwan/*"], "no scenario is called drwan/*"),
        (["run", "--scenario", "drawn/wiener", "--method", "mine"], "unknown method 'mine'"),
        (["run", "--scenario", "drawn/wiener", "--method", "mine.py"], "there is no method file mine.py"),
        (["run", "--scenario", "drawn/wiener", "--seeds", "0"], "--seeds is 0"),
        (["run", "--scenario", "drawn/wiener", "--budget", "-1"], "--budget is -1"),
        (["run", "--scenario", "drawn/wiener", "--first", "-1"], "--first is -1"),
        (["run", "--scenario", "drawn/wiener", "--out", "t.csv"], "ends in .parquet"),
        (["run", "--scenario", "drawn/wiener", "--records", "nowhere"], "there is no folder nowhere"),
        (["run", "--scenario", "drawn/wiener", "--workers", "0"], "workers is 0"),
        (["report", "none.parquet"], "run them first: qpal bench run"),
        (["export", "drawn/none"], "unknown scenario of drawn 'none'"),
        (["export", "none"], "unknown family of scenarios 'none'"),
        (["install", "nobody"], "unknown method 'nobody'"),
        (["add", "my-method"], "is no name for a method"),
    ],
)
def test_what_is_wrong_is_a_sentence(arguments, sentence, here, capsys):
    text = said(arguments, capsys, 2)
    assert sentence in " ".join(text.split())
    assert "Traceback" not in text
    assert not list(here.glob("**/*.parquet"))


@pytest.mark.parametrize("rows", [True, False])
def test_a_stopped_run_says_what_is_there(rows, here, capsys, monkeypatch):
    def stopped(cells, table, *rest):
        if rows:
            (here / "t.journal").write_text("{}\n")
        raise KeyboardInterrupt

    monkeypatch.setattr("sysid.bench.cell.run_cells", stopped)
    arguments = ["run", "--scenario", "stress/short", "--method", "output_error", "--seeds", "1", "--out", "t.parquet"]
    kept = "the rows so far are in t.parquet; the same command goes on from there"
    found = said(arguments, capsys, 130)
    assert found.endswith(f"qpal: stopped; {kept if rows else 'no row was finished, and nothing was written'}\n")
