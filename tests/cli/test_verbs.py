"""The three verbs on good input: what they write, print and return."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from functools import partial
from typing import Any

import numpy as np
import pytest
import scipy.signal
from foreign import FOREIGN, ROBOT
from often import FULL
from pages import assert_stands_alone, without_seconds

import sysid
import twin
from sysid import formats
from sysid.base import criteria
from sysid.data.preprocess import quick_start
from sysid.report.page import Page
from sysid.selection.space import Space
from sysid.structures import HammersteinWiener
from sysid.workflow import identification
from sysid.workflow.evaluation import evaluate
from sysid.workflow.record import read_record
from sysid.workflow.setting import Setting
from twin.cli import main

TS = 0.05
POLES = np.array([0.9, 0.6])


def known_system(N: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """u and the noise-free y = (0.5 z^-1 + 0.2 z^-2) / ((1 - 0.9 z^-1)(1 - 0.6 z^-1)) u, all to 12 digits."""
    rng = np.random.default_rng(4)
    u = np.repeat(rng.choice([-1.0, 0.25, 1.0], N // 4), 4)
    y = scipy.signal.lfilter([0.0, 0.5, 0.2], np.poly(POLES), u)
    return u, np.round(y, 12)


def rows(separator: str, header: str | None, decimal: str = ".", end: str = "\n", tail: str = "") -> str:
    lines = [] if header is None else [header + tail]
    lines += [
        f"{a!r}{separator}{b!r}{tail}".replace(".", decimal)
        for a, b in zip(*map(np.ndarray.tolist, known_system()), strict=True)
    ]
    return end.join(lines) + end


TEXTS = {
    "comma.csv": rows(",", '"u","y"'),
    "trailing_comma.csv": rows(",", '"u","y"', tail=","),
    "semicolon_decimal_comma.csv": rows(";", "u;y", decimal=","),
    "crlf_and_bom.csv": "\ufeff" + rows(",", "u,y", end="\r\n"),
    "tab.txt": rows("\t", "u\ty"),
    "tab.tsv": rows("\t", "u\ty"),
    "no_header.dat": rows("   ", None).replace("\n", "\n  "),
    "comments.txt": "# recorded on a Monday\n\n% another remark\n" + rows(" ", "u y"),
}


def test_there_is_a_file_of_every_format():
    assert {os.path.splitext(name)[1] for name in (*TEXTS, *FOREIGN)} == set(formats.TABLE)


@pytest.mark.parametrize("name", [*TEXTS, *FOREIGN])
def test_every_format_reads_the_same_numbers(name, tmp_path):
    u, y = known_system()
    path = tmp_path / name
    if name in TEXTS:
        path.write_text(TEXTS[name], encoding="utf-8", newline="")
    else:
        FOREIGN[name](path, u, y)
    record = read_record(path, *ROBOT.get(name, ()), Ts=TS)
    assert np.array_equal(record.data.u[:, 0], u)
    assert np.array_equal(record.data.y[:, 0], y)
    assert record.notes or name in ROBOT  # it says which column it took as the input


def test_identify_recovers_known_poles_and_writes_the_summary(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text(TEXTS["comma.csv"])
    arguments = ["log.csv", "--ts", str(TS), "--structure", "output_error", "--orders", "2,2,1", "--detrend", "none"]
    assert main(["identify", *arguments, "--json", "--out", "result"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    summary = json.loads(out)
    assert summary == json.loads((tmp_path / "result" / "summary.json").read_text(encoding="utf-8"))
    found = sorted(pole["re"] for pole in summary["poles"])
    np.testing.assert_allclose(found, sorted(POLES), atol=1e-6)
    assert summary["fit_percent"]["validation"] > 99.99
    assert set(summary["fit_percent"]) == {"estimation", "validation"}
    assert set(summary["criteria"]) == {"loss", "mse", "N", "d", *criteria.TABLE}
    assert set(summary["poles"][0]) >= {"re", "im", "std"}
    assert set(summary["parameters"][0]) >= {"name", "value", "std", "unit", "free"}
    assert set(summary["stop"]) >= {"reason", "iterations", "evaluations"}
    assert {"zeros", "residuals", "seconds", "versions"} <= set(summary)
    read = summary["read"]
    assert (read["input"], read["output"], read["Ts"], read["samples"], read["split"]) == ("u", "y", TS, 400, 0.5)
    assert summary["setting"]["orders"] == {"nb": 2, "nf": 2, "nk": 1}


def test_identify_prints_a_table_and_a_report_that_needs_no_network(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text(TEXTS["comma.csv"])
    assert main(["identify", "log.csv", "--ts", str(TS)]) == 0
    out, _ = capsys.readouterr()
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("-identify")
    assert all(re.search(rf"{c.label}\b", out) for c in criteria.TABLE.values())
    assert str(folder.relative_to(tmp_path) / "report.html") in out
    html = (folder / "report.html").read_text(encoding="utf-8")
    assert_stands_alone(html)
    assert all(f">{c.label}</abbr></td>" in html and f">{c.meaning}</td>" in html for c in criteria.TABLE.values())
    pictures = list((folder / "figures").glob("*.png"))
    assert html.count("<figcaption>") == html.count("<img ") == len(pictures) >= 6


def test_the_model_files_say_what_the_summary_says_on_the_records_own_scale(tmp_path):
    u, y = known_system()
    path = tmp_path / "log.csv"
    path.write_text(
        "u,y\n" + "".join(f"{a + 5.0!r},{b - 30.0!r}\n" for a, b in zip(u.tolist(), y.tolist(), strict=True))
    )
    arguments = ["--ts", str(TS), "--structure", "output_error", "--orders", "2,2,1", "--detrend", "mean"]
    arguments += ["--out", str(tmp_path / "out")]
    assert main(["identify", str(path), *arguments]) == 0
    fit = sysid.load(tmp_path / "out" / "model.json")
    names: dict[str, Any] = {"__name__": "model"}
    exec((tmp_path / "out" / "model.py").read_text(encoding="utf-8"), names)
    found = np.array(names["simulate"]((u + 5.0).tolist()))
    expected = fit.simulate(u - u.mean()) + (y - 30.0).mean()  # means were removed before the fit
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert "double model_step(" in (tmp_path / "out" / "model.c").read_text(encoding="utf-8")
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert all(f"model.{suffix}" in html for suffix in ("json", "c", "py"))
    assert "The model in closed form" in html


def test_identify_nlarx_keeps_free_run_and_one_step_apart(tmp_path, capsys):
    (tmp_path / "log.csv").write_text(TEXTS["comma.csv"])
    arguments = [str(tmp_path / "log.csv"), "--ts", str(TS), "--structure", "nlarx", "--starts", "2"]
    assert main(["identify", *arguments, "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "fit, free run, validation data" in out
    assert "fit, ONE STEP ahead, validation data" in out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["setting"]["orders"] == {"na": 2, "nb": 2, "nk": 1}
    assert summary["fit_percent"]["validation"] > 99.9  # the plant is an ARX model of these orders
    assert summary["one_step_fit_percent"]["validation"] > 99.9
    assert summary["criteria_of"] == "one step ahead"
    assert summary["poles"] == []
    names = {path.stem for path in (tmp_path / "out" / "figures").iterdir()}
    assert {"free-run", "residuals"} <= names
    assert not names & {"pole-zero", "step-response", "static-maps"}
    assert {path.name for path in (tmp_path / "out").glob("model.*")} == {
        "model.json",
        "model.h",
        "model.c",
        "model.py",
    }


def test_identify_auto_finds_a_linear_plant_and_goes_on_from_its_journal(tmp_path, capsys, monkeypatch):
    """By day every structure is tried, with the best orders alone; tests/recovery/test_select.py tries others."""
    if not FULL:
        monkeypatch.setattr(identification, "Space", partial(Space, kept_orders=1, grows=False))
    (tmp_path / "log.csv").write_text(TEXTS["comma.csv"])
    journal = tmp_path / "journal.jsonl"
    arguments = [
        str(tmp_path / "log.csv"),
        "--ts",
        str(TS),
        "--structure",
        "auto",
        "--starts",
        "1",
        "--detrend",
        "none",
        "--seconds",
        "3600",  # on a busy machine the budget would end one of the two searches earlier
    ]
    arguments += ["--resume", str(journal), "--out", str(tmp_path / "out")]
    summaries = []
    for _ in range(2):
        assert main(["identify", *arguments]) == 0
        out = capsys.readouterr().out
        assert "has the best free run on unseen data" in out
        assert "chosen" in out
        summaries.append(json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8")))
        finished = journal.read_bytes()
    assert journal.read_bytes() == finished  # nothing was judged twice
    assert without_seconds(summaries[0]) == without_seconds(summaries[1])
    selection = summaries[0]["selection"]
    assert selection["chosen"]["structure"] == summaries[0]["setting"]["structure"]
    assert summaries[0]["fit_percent"]["validation"] > 99.9
    assert "Structure search" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def directly():
    """The thigh's simulated record, identified without a file."""
    experiment = twin.Experiment(joint="thigh", duration=60.0, seed=3).run()
    return evaluate(Setting(HammersteinWiener(2, 2, 1)), *quick_start(experiment.io()))


@pytest.mark.parametrize(
    "suffix", [".csv", *(pytest.param(s, marks=pytest.mark.nightly) for s in formats.WRITTEN if s != ".csv")]
)
def test_a_simulated_log_is_identified_as_if_it_had_never_been_a_file(suffix, directly, tmp_path, capsys):
    log = tmp_path / f"thigh{suffix}"
    arguments = ["--joint", "thigh", "--duration", "60", "--seed", "3", "--log", str(log), "--out", str(tmp_path / "s")]
    assert main(["simulate", *arguments]) == 0
    capsys.readouterr()
    columns = [] if suffix == ".csv" else ["--input", "voltage_V", "--output", "angle_rad", "--time", "time_s"]
    assert main(["identify", str(log), *columns, "--orders", "2,2,1", "--json", "--out", str(tmp_path / "i")]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["read"]["Ts"] == 0.1
    # The file rounds the last digit, which the rounds of the maps' prior make 2e-9 of.
    assert summary["fit_percent"]["validation"] == pytest.approx(directly.validation_fit, abs=1e-7)


def test_simulate_writes_its_log_into_out_by_default(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "--duration", "5", "--without", "noise, adc", "--out", "a/b", "--json"]) == 0
    assert {path.name for path in (tmp_path / "a" / "b").iterdir()} == {
        "log.csv",
        "report.html",
        "summary.json",
        "plotly.min.js",
        "figures",
    }
    log = twin.Log.load(tmp_path / "a" / "b" / "log.csv")
    assert log.y_true is not None
    np.testing.assert_allclose(log.y, log.y_true, atol=1e-9)  # nothing is left that could part them


@pytest.mark.parametrize(
    ("failure", "existing"),
    [(OSError(28, "No space left on device"), True), (RuntimeError("a bug"), False), (KeyboardInterrupt(), True)],
)
def test_a_run_that_fails_while_writing_leaves_nothing(failure, existing, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text(TEXTS["comma.csv"])
    if existing:
        (tmp_path / "runs" / "mine").mkdir(parents=True)
        (tmp_path / "runs" / "mine" / "summary.json").write_text("{}")
    before = {path: path.read_bytes() if path.is_file() else None for path in tmp_path.rglob("*")}

    def fail(page, beside):
        raise failure

    monkeypatch.setattr(Page, "html", fail)  # the figures are written by then
    arguments = ["identify", "log.csv", "--ts", "0.05", "--out", "runs/mine"]
    if isinstance(failure, RuntimeError):
        with pytest.raises(RuntimeError, match="a bug"):
            main(arguments)
    else:
        assert main(arguments) == (130 if isinstance(failure, KeyboardInterrupt) else 2)
        assert capsys.readouterr().err.count("\n") == 1
    assert {path: path.read_bytes() if path.is_file() else None for path in tmp_path.rglob("*")} == before


def test_a_second_run_replaces_the_files_of_the_first_and_keeps_others(tmp_path):
    (tmp_path / "log.csv").write_text(TEXTS["comma.csv"])
    for seed in ("1", "2"):
        assert main(["simulate", "--duration", "5", "--seed", seed, "--out", str(tmp_path / "out")]) == 0
        (tmp_path / "out" / "notes.txt").touch()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["log"]["seed"] == 2
    assert (tmp_path / "out" / "notes.txt").exists()
    assert not list(tmp_path.glob(".*"))


def ended(process):
    """What a process printed; one that goes on for minutes after it was told to stop is a failure."""
    try:
        return process.communicate(timeout=120)
    finally:
        process.kill()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_run_cleans_up_and_says_so(number, tmp_path):
    command = [sys.executable, "-m", "twin.cli", "reproduce", "--duration", "20000", "--out", "runs/long"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not list(tmp_path.glob("runs/.long-*")):  # until it works; the test's own time limit is the runner's
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(number)
    out, err = ended(process)
    assert process.returncode == 130
    assert (out, err) == ("", "qpal: stopped; nothing was written\n")
    assert not list(tmp_path.iterdir())


def test_a_stopped_search_keeps_its_journal_and_says_how_to_go_on(tmp_path):
    (tmp_path / "log.csv").write_text(TEXTS["comma.csv"])
    command = [sys.executable, "-m", "twin.cli", "identify", "log.csv", "--ts", "0.05", "--structure", "auto"]
    command += ["--resume", "kept.jsonl", "--out", "out"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    journal = tmp_path / "kept.jsonl"
    while not (journal.exists() and journal.read_bytes().count(b"\n") > 3):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    out, err = ended(process)
    assert process.returncode == 130
    assert out == ""
    assert err.splitlines()[-1] == "qpal: stopped; run it again with --resume kept.jsonl to continue from there"
    assert {path.name for path in tmp_path.iterdir()} == {"log.csv", "kept.jsonl"}
