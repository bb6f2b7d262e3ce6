"""The first screens of `qpal info`, `export` and `bench certify`: their words, and their next step works."""

import re
import shlex
import shutil
import subprocess
import sys
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.report import inspection
from sysid.report.answer import WORDS
from sysid.report.certificate import answer as certified
from sysid.workflow.inspection import inspect_file
from sysid.workflow.saved import UNFIT
from twin.cli import main
from twin.report import export_answer

MODEL = Path(__file__).parents[1] / "saved" / "v1"


@pytest.fixture
def log(tmp_path, monkeypatch) -> Path:
    """A record of a lag, and a capture of the same that lost three rows."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, 30), 10)
    y = lfilter([0.0, 0.3], [1.0, -0.7], u) + 0.01 * rng.normal(size=300)
    rows = np.column_stack([0.1 * np.arange(300), u, y])
    heading = "time [s],u [V],angle [rad]"
    np.savetxt("log.csv", rows, "%.6g", ",", header=heading, comments="")
    np.savetxt("lost.csv", np.delete(rows, [50, 51, 200], 0), "%.6g", ",", header=heading, comments="")
    return Path("log.csv")


def screen(arguments: list[str], capsys, code: int = 0) -> tuple[str, str, str]:
    """The word (or nothing), the words above the picture, and the next step of a verb's page and terminal."""
    assert main([*arguments, "--out", "out"]) == code
    said = " ".join(capsys.readouterr().out.split())
    html = Path("out/report.html").read_text(encoding="utf-8")
    word, above = re.search(r'<div class="answer (\w*)">(.*?)</div>', html, re.S).groups()
    text = " ".join(unescape(re.sub("<[^>]+>", " ", above)).split())
    assert len(text.split()) <= WORDS
    step = re.search(r'<p class="next">(.*?)</p>', html, re.S)[1]
    step = " ".join(unescape(re.sub("<[^>]+>", "", step)).split())
    assert step in said
    assert html.index('class="answer') < html.index('class="next"') < html.index("In words")
    return word, text, step


def test_a_clean_log_is_good_and_its_next_step_identifies_it(log, capsys):
    word, text, step = screen(["info", "log.csv"], capsys)
    assert word == "good"
    assert "300 samples" in text
    assert main([*shlex.split(step.removeprefix("Next: "))[1:], "--starts", "1", "--trials", "0", "--out", "next"]) == 0


def test_a_repair_makes_it_usable_and_a_file_that_is_not_read_is_poor(log, capsys):
    word, text, _ = screen(["info", "lost.csv"], capsys)
    assert word == "usable"
    assert "lost" in text
    Path("bad.csv").write_text("t,u,y,z\n0,1,2,3\n1,2,3,4\n2,2,5,4\n")
    word, text, step = screen(["info", "bad.csv"], capsys, code=1)
    assert word == "poor"
    assert "steps of 1 may be 1 s" in text
    assert main([*shlex.split(step.removeprefix("Next: "))[1:], "--out", "next"]) == 1
    assert Path("MAP.toml").exists()


def test_the_problem_of_a_file_says_what_to_do(log):
    result = inspect_file("log.csv")
    problem = SimpleNamespace(
        **{**vars(result), "problem": "a gap of 3 s; give --range 0:5", "command": "", "lack": ""}
    )
    made = inspection.answer(problem, None)
    assert (made.word, made.sentence, made.next) == ("usable", "A gap of 3 s.", "Next: give --range 0:5")


def test_the_leg_alone_has_no_word_and_can_be_simulated(log, capsys):
    word, text, step = screen(["info", "--joint", "thigh"], capsys)
    assert (word, step) == ("", "Next: qpal simulate --joint thigh")
    assert "1 joint" in text
    assert main([*shlex.split(step.removeprefix("Next: "))[1:], "--out", "next"]) == 0


@pytest.mark.parametrize(("way", "program"), [("--c", "cc"), ("--python", sys.executable), ("--matlab", "octave")])
def test_what_was_exported_is_taken_into_use_by_the_next_step(way, program, log, capsys):
    arguments = ["log.csv", "--structure", "output_error", "--orders", "1,1,1", "--starts", "1", "--trials", "0"]
    assert main(["identify", *arguments, "--out", "a fit"]) == 0
    capsys.readouterr()
    word, text, step = screen(["export", "a fit/model.json", way], capsys)
    assert word == ""
    assert "file" in text
    if shutil.which(program) is None:
        pytest.skip(f"no {program} here")
    words = shlex.split(step.removeprefix("Next: "))
    words[0] = program if words[0] in ("python", program) else words[0]
    found = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60, check=False)
    assert found.returncode == 0, found.stderr


def test_a_fit_that_is_unfit_for_use_exports_as_poor():
    fit = SimpleNamespace(warnings=(f"{UNFIT} here",))
    result = SimpleNamespace(source=SimpleNamespace(fit=fit, trouble=None), close=True, check=None)
    assert export_answer.word(result) == "poor"
    fit.warnings = ("something else",)
    assert export_answer.word(result) == "usable"
    fit.warnings = ()
    assert export_answer.word(result) is None
    result.check = object()
    assert export_answer.word(result) == "good"
    result.close = False
    assert export_answer.word(result) == "poor"


def test_a_certificate_counts_the_fits_of_its_method_and_names_the_worst_record(log, capsys):
    word, text, step = screen(["bench", "certify", "stated", "--record", "oe_fast", "--record", "oe_slow"], capsys)
    assert word == "good"
    assert text.startswith("4 of 4 good")
    command = shlex.split(step.partition(": ")[2])
    assert command[:4] == ["qpal", "bench", "certify", "stated"]
    assert main([*command[1:], "--out", "next"]) == 0


def test_a_broken_rule_is_poor_and_methods_of_others_have_no_word():
    row = SimpleNamespace(record="a", level="lower", start=1, method="m", parameters=2.0, deviations=2.0, rss=3.0)
    rows = [row, SimpleNamespace(**{**vars(row), "start": 2, "parameters": 7.0})]
    assert (certified(rows, ["broken"], True, {}).word, certified(rows, [], False, {}).word) == ("poor", None)
    made = certified(rows, [], False, {"m": "my file.py"})
    assert made.number == "1 of 2"
    assert made.next.endswith("qpal bench certify 'my file.py' --record a")
