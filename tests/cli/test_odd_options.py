"""Every option of every verb with values that nobody means: one sentence, or the run begins; nothing else.

The work itself is left out: a run that would begin ends where it opens its folder, so that what is refused is refused
before it.
"""

import inspect
import re
from typing import get_args

import pytest
import typer
from cases import VERBS, without, write_lag

import twin
from sysid.report.page import Page, write
from twin.cli import app, main, output

GROUP = typer.main.get_command(app.build()).commands
GOOD = {**VERBS, "view": ["leg.csv", "--strip", "new.png"], "app": ["--no-browser", "--session", "folder"]}
NUMBERS = ("nan", "inf", "-inf", "-1", "0", "1e308", "-1e308", "1e-308", "1e9", "1000000000", "9" * 30)
TEXTS = ("", ".", " ", "folder", "log.csv", "nowhere/x", "x" * 10_000, "\udcff\udcfe", "a,b", "a=b", "1:0", "\0", "é\n")
PLACE = re.compile(r"[\[{]?(FILE|DIR|LOG|MODEL)")
OPTIONS = [
    pytest.param(verb, parameter, id=f"{verb} {parameter.opts[0]}")
    for verb in sorted(GOOD)
    for parameter in GROUP[verb].params
    if parameter.param_type_name == "option" and not parameter.is_flag
]


class Begun(Exception):  # noqa: N818 - it is no error
    """The options were taken and the run began."""


def takes_a_number(verb, option):
    function = next(each for each in app.VERBS if each.__name__ == GROUP[verb].callback.__name__)
    annotation = inspect.signature(function, eval_str=True).parameters[option.name].annotation
    kind = get_args(annotation)[0]
    return bool({int, float} & {kind, *get_args(kind)})


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A record of y_t = 0.8 y_{t-1} + u_{t-1}, a model of it, and a log of the leg."""
    folder = tmp_path_factory.mktemp("odd")
    write_lag(folder)
    log = twin.Experiment("shoulder", "sweep", 8.0, 0.05, options={"half_period": 2.0}).run()
    log.save(folder / "leg.csv")
    (folder / "folder").mkdir()
    return folder


@pytest.fixture
def stopped(place, monkeypatch):
    """No work: what opens the folder of a run, makes a session or draws ends in `Begun`."""
    monkeypatch.chdir(place)

    def begins(*given, **more):
        raise Begun

    for verb in GOOD:
        monkeypatch.setattr(f"twin.cli.{'browser' if verb == 'app' else verb}.run_folder", begins, raising=False)
    monkeypatch.setattr(output, "run_folder", begins)
    monkeypatch.setattr("twin.app.session.Session.open", begins)
    monkeypatch.setattr("twin.cli.view._replay", begins)
    return place


@pytest.mark.parametrize(("verb", "option"), OPTIONS)
def test_an_odd_value_is_one_sentence_or_begins_the_run(verb, option, stopped, capsys):
    before = sorted(path.name for path in stopped.rglob("*"))
    for value in (*NUMBERS, "", "x" * 10_000, "1:0", "\0") if takes_a_number(verb, option) else (*TEXTS, "nan", "-1"):
        try:
            code = main([verb, *without(GOOD[verb], option.opts[0]), option.opts[0], value])
        except Begun:
            code = 0
        out, err = capsys.readouterr()
        assert sorted(path.name for path in stopped.rglob("*")) == before, value[:20]
        if code == 0:
            assert not (PLACE.match(str(option.metavar)) and not value.strip()), value
            assert "\0" not in value
            continue
        assert code == 2, value[:20]
        assert out == ""
        assert re.fullmatch(r"qpal: [^\n]{10,2100}\n", err), (value[:20], err[-300:])
        assert "Traceback" not in err
        assert "Warning" not in err


@pytest.mark.parametrize(("verb", "option"), [p for p in OPTIONS if not p.values[1].multiple])
def test_an_option_given_twice_is_refused(verb, option, stopped, capsys):
    """The last one counted, in silence: `--input u1 --input u2` identified a model of u2 alone."""
    name = option.opts[0]
    assert main([verb, *without(GOOD[verb], name), name, "1", name, "2"]) == 2
    assert capsys.readouterr().err.startswith(f"qpal: {name} is given 2 times; give it once")


@pytest.mark.parametrize("verb", sorted(set(GOOD) - {"view", "app"}))
@pytest.mark.parametrize("out", ["", " "])
def test_a_folder_without_a_name_is_refused_before_the_work(verb, out, stopped, capsys):
    assert main([verb, *GOOD[verb], "--out", out]) == 2
    assert (
        capsys.readouterr().err == f"qpal: --out is {out!r}, which names no file or folder; give DIR, or leave it out\n"
    )


@pytest.mark.parametrize("value", ["1e9", "1e12"])
def test_a_sampling_time_of_years_is_refused(value, place, monkeypatch, capsys):
    monkeypatch.chdir(place)
    assert main(["info", "--joint", "thigh", "--ts", value, "--out", "made"]) == 2
    assert re.search(r"Ts is 1e\+?\d+|Ts is 1000000000", capsys.readouterr().err)
    assert not (place / "made").exists()


def test_bytes_of_a_name_that_are_no_text_may_stand_in_a_report(tmp_path):
    (tmp_path / "made").mkdir()
    write(tmp_path / "made", Page("one", "two", ()), {"file": "a\udcff"})
    assert "a\\udcff" in (tmp_path / "made" / "summary.json").read_text(encoding="utf-8")
