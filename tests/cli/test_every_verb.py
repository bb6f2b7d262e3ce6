"""What holds of every verb: its help, the options that all have, what it leaves behind, and how it refuses."""

import inspect
import json
import re
import shutil
from typing import get_args

import pytest
import typer
from cases import VERBS, without, write_lag
from often import by_day
from pages import assert_stands_alone

import twin
from sysid.report.page import SCRIPT
from twin.cli import app, main
from twin.studies import protocol

pytestmark = pytest.mark.pixels

GROUP = typer.main.get_command(app.build()).commands  # `bench` among them, whose verbs have their own tests
COMMANDS = {verb.__name__: GROUP[verb.__name__] for verb in app.VERBS}
REPORTING = [verb.__name__ for verb in app.VERBS if verb not in app.SHOWN]
SHARED = ("input", "output", "time", "params", "out", "as_json")  # one text wherever they are


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A record of y_t = 0.8 y_{t-1} + u_{t-1}, a saved model of it, and a log of the leg."""
    made = tmp_path_factory.mktemp("files")
    write_lag(made)
    twin.Experiment("shoulder", "sweep", 8.0, 0.05, options={"half_period": 2.0}).run().save(made / "leg.csv")
    return made


@pytest.fixture
def folder(files, tmp_path, monkeypatch):
    """A working folder with these files."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    return tmp_path


def options_of(verb):
    return [parameter for parameter in COMMANDS[verb].params if parameter.param_type_name == "option"]


def numbers_of(verb):
    """The options that take a number, by the types that the verb gives them."""
    function = next(each for each in app.VERBS if each.__name__ == verb)
    types = {
        name: get_args(parameter.annotation)[0]
        for name, parameter in inspect.signature(function, eval_str=True).parameters.items()
        if get_args(parameter.annotation)
    }
    return [each for each in options_of(verb) if {int, float} & {types[each.name], *get_args(types[each.name])}]


def test_every_verb_that_reports_has_a_good_run():
    assert set(VERBS) == set(REPORTING)


# By day `.ci/run` runs `demo` and `reproduce`, tests/cli/test_design.py and tests/physics/test_crawl.py run theirs.
ELSEWHERE = {"crawl", "demo", "design", "reproduce"}


@pytest.mark.parametrize("verb", by_day(REPORTING, *(set(REPORTING) - ELSEWHERE)))
def test_a_good_run_leaves_a_report_and_prints_its_summary(verb, folder, capsys, monkeypatch):
    monkeypatch.setattr(protocol, "PAPER", {"shoulder": protocol.PAPER["shoulder"]})  # `reproduce`: one joint is enough
    assert main([verb, *VERBS[verb], "--json", "--out", "made/here"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    summary = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    made = folder / "made" / "here"
    assert summary == json.loads((made / "summary.json").read_text(encoding="utf-8"))
    html = (made / "report.html").read_text(encoding="utf-8")
    figures = list((made / "figures").iterdir())
    assert figures
    assert html.count("<img ") == len(figures)
    assert_stands_alone(html)
    assert not re.search(r"<script\b[^>]*src=", html) or (made / SCRIPT).is_file()
    assert {path.name for path in folder.iterdir()} == {"log.csv", "leg.csv", "model.json", "made"}


@pytest.mark.parametrize("verb", [verb.__name__ for verb in app.VERBS])
def test_shared_options_are_one_everywhere(verb):
    texts = {parameter.name: parameter.help for parameter in options_of(verb) if parameter.name in SHARED}
    assert verb not in REPORTING or {"out", "as_json"} <= set(texts)
    for other in COMMANDS:
        for parameter in options_of(other):
            assert texts.get(parameter.name, parameter.help) == parameter.help


def refused(arguments, folder, capsys):
    """The one sentence on standard error of a verb that ends with 2 and leaves nothing."""
    before = sorted(folder.rglob("*"))
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("qpal: ")
    assert err.count("\n") == 1
    assert sorted(folder.rglob("*")) == before
    return err


@pytest.mark.parametrize(
    ("verb", "option"),
    [(verb, parameter.opts[0]) for verb in COMMANDS for parameter in numbers_of(verb)],
)
def test_a_number_that_is_none_is_refused(verb, option, folder, capsys):
    said = refused([verb, *without(VERBS.get(verb, []), option), option, "many"], folder, capsys)
    assert option in said
    assert "found 'many', give a" in said


@pytest.mark.parametrize("verb", COMMANDS)
def test_an_option_that_does_not_exist_is_refused(verb, folder, capsys):
    said = refused([verb, *VERBS.get(verb, []), "--nonsense", "1"], folder, capsys)
    assert "--nonsense" in said
    assert f"see qpal {verb} --help" in said


@pytest.mark.parametrize("verb", REPORTING)
def test_an_out_that_is_a_file_is_refused_before_the_work(verb, folder, capsys, monkeypatch):
    monkeypatch.setattr("twin.cli.console.Steps.__call__", lambda *_: pytest.fail("it began to work"))
    said = refused([verb, *VERBS[verb], "--out", "log.csv"], folder, capsys)
    assert "cannot write to log.csv" in said


@pytest.mark.parametrize("verb", [verb for verb in REPORTING if any(p.name == "params" for p in options_of(verb))])
def test_parameters_that_are_nowhere_are_refused(verb, folder, capsys):
    assert "nowhere.toml" in refused([verb, *VERBS[verb], "--params", "nowhere.toml"], folder, capsys)
