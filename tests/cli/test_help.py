"""What `qpal VERB --help` shows is what the code says, brackets included."""

import re

import pytest
import typer

from twin.cli import main
from twin.cli.app import VERBS, build


@pytest.mark.parametrize("verb", [verb.__name__ for verb in VERBS])
def test_help_of_every_option_is_shown_whole(verb, capsys):
    command = typer.main.get_command(build()).commands[verb]
    assert main([verb, "--help-all" if verb == "identify" else "--help"]) == 0
    shown = _solid(capsys.readouterr().out)
    assert _solid(command.help) in shown
    helps = [parameter.help for parameter in command.params if parameter.name != "help"]
    assert helps
    for text in helps:
        assert text, "every option says what it is for"
        assert _solid(text) in shown


def test_every_verb_has_its_line_whole_at_80_columns(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["-h"]) == 0
    blocks = capsys.readouterr().out.split("\n\n")[3:]
    verbs = [line for block in blocks for line in block.strip("\n").splitlines()[1:]]
    assert len(verbs) == len(VERBS) + 2  # and rig and bench
    for line in verbs:
        assert line.endswith(".")
        assert not line.endswith("...")


def test_arguments_are_shown_without_python_types(capsys):
    for verb, usage in (("identify", "{FILE...}"), ("run", "{MODEL... FILE}"), ("design", "{FILE}")):
        assert main([verb, "-h"]) == 0
        shown = capsys.readouterr().out
        assert shown.splitlines()[0].endswith(usage)
        assert "<" not in shown.partition("Arguments:")[2].partition("Options:")[0]


def test_brackets_are_not_swallowed(capsys):
    assert main(["identify", "--help-all"]) == 0
    shown = _solid(capsys.readouterr().out)
    assert _solid("what to remove [none: the zero of the output is a parameter]: ") in shown
    assert _solid("of nlarx na,nb,nk; of state_space nx,units,degree [2,3,1; 2,3,1,2,2; 9; 2,2,1; 2,5,0]") in shown


def test_identify_shows_what_most_need_and_the_options_of_a_structure_with_it(capsys):
    def shown(*words):
        assert main(["identify", *words, "--help"]) == 0
        return set(re.findall(r"^  (--[a-z-]+)", capsys.readouterr().out.partition("\nOptions:")[2], re.M))

    first = shown()
    assert len(first) <= 15
    for words in (["--structure", "servo_joint"], ["--structure=servo-joint"]):
        assert {"--loop", "--kp", "--ki"} <= shown(*words) - first
    assert main(["identify", "--structure", "servo_joint", "--help"]) == 0
    assert "an actuated joint" not in capsys.readouterr().out.partition("--orders")[2]
    assert "--driver-step" not in shown("--structure", "servo_joint")
    assert "--driver-step" in shown("--structure", "actuated_joint")
    assert shown("--structure", "no_such") == first


def test_an_old_verb_is_told_what_it_is_called_now(capsys):
    assert main(["models", "a.json", "my log.csv", "--ts", "0.1"]) == 2
    assert (
        capsys.readouterr().err == "qpal: qpal models is called qpal run now: qpal run a.json 'my log.csv' --ts 0.1\n"
    )


def _solid(text: str) -> str:
    """Without white space and frames: lines may break anywhere."""
    return re.sub(r"[\s│]", "", text)


def test_the_first_lines_are_for_a_newcomer(capsys):
    """What most never need is found with the benchmark, and still works."""
    assert main(["--help"]) == 0
    assert "--certificate" not in capsys.readouterr().out
    assert main(["--certificate"]) == 0
    assert "QPAL" in capsys.readouterr().out
