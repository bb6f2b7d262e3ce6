"""Parameters as a file: every bit comes back, and what is wrong with a file is said in one sentence."""

import json
import os
import tomllib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sysid.base import files
from sysid.base.errors import InputError
from twin.cli.options import parameters as from_option
from twin.parameter_file import LARGEST, read, write
from twin.parameters import TABLE, Parameters

SUFFIXES = (".toml", ".json")
SOME = st.sets(st.sampled_from(TABLE)).flatmap(
    lambda rows: st.fixed_dictionaries({row.name: st.floats(row.lower, row.upper) for row in rows})
)


@pytest.mark.parametrize("everything", [False, True])
@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=SOME)
def test_every_bit_comes_back(suffix, everything, values, tmp_path):
    parameters = Parameters(values)
    path = write(parameters, tmp_path / f"leg{suffix}", all=everything)
    assert read(path) == parameters
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_only_what_differs_stands_there_unless_all_is_asked_for(suffix, tmp_path):
    def names(all: bool) -> set[str]:
        text = write(parameters, tmp_path / f"leg{suffix}", all=all).read_text(encoding="utf-8")
        found = tomllib.loads(text) if suffix == ".toml" else json.loads(text)
        tables = {k: v for k, v in found.items() if isinstance(v, dict)}
        return (found.keys() - tables.keys()) | {f"{t}.{k}" for t, entries in tables.items() for k in entries}

    parameters = Parameters({"thigh.coulomb": 40.0, "gravity": 1.62, "shank.stroke": Parameters()["shank.stroke"]})
    assert names(all=False) == {"thigh.coulomb", "gravity"}  # the stroke given is the nominal one
    assert names(all=True) == {row.name for row in TABLE}
    parameters = Parameters()
    assert names(all=False) == set()
    assert read(tmp_path / f"leg{suffix}") == parameters


def test_toml_says_unit_bounds_and_source_of_every_value(tmp_path):
    text = write(Parameters({"thigh.backlash": 0.0175}), tmp_path / "leg.toml", all=True).read_text(encoding="utf-8")
    lines = text.splitlines()
    assert sum(" = " in line for line in lines) == len(TABLE)
    (backlash,) = [line for line in lines[lines.index("[thigh]") :] if line.startswith("backlash")][:1]
    assert backlash.startswith("backlash = 0.0175  # rad (1.003 deg) instead of 0.00872664")
    assert "0.0005 to 0.1; " in backlash
    for row in TABLE:
        assert any(line.endswith(row.source) for line in lines if line.startswith(row.name.rpartition(".")[2] + " = "))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("tables.toml", "gravity = 9\n[thigh]\ncoulomb = 40 # N\n"),
        ("dotted.toml", "thigh.coulomb = 40.0\ngravity = 9.0"),
        ("quoted.toml", '"thigh.coulomb" = 4e1\ngravity = 9\n'),
        ("windows.toml", "\ufeffgravity = 9\r\n[thigh]\r\ncoulomb = 40\r\n"),
        ("LOUD.TOML", "gravity = 9\n[thigh]\ncoulomb = 40\n"),
        ("tables.json", '{"thigh": {"coulomb": 40}, "gravity": 9}'),
        ("flat.json", '{"thigh.coulomb": 40.0, "gravity": 9.0}'),
    ],
)
def test_what_people_write_is_read(name, text, tmp_path):
    (tmp_path / name).write_bytes(text.encode())
    assert read(tmp_path / name).changed() == {"thigh.coulomb": 40.0, "gravity": 9.0}


def test_a_file_of_comments_is_nominal(tmp_path):
    (tmp_path / "leg.toml").write_text("# nothing yet\n")
    assert read(tmp_path / "leg.toml") == Parameters()


DEEP = 100_000
BAD: dict[str, tuple[str, str | bytes, list[str]]] = {
    "suffix": ("leg.yaml", "gravity: 9", ["cannot be .yaml", ".toml or .json"]),
    "no suffix": ("leg", "gravity = 9", ["without suffix", ".toml or .json"]),
    "empty": ("leg.toml", "", ["is empty", "--write-params"]),
    "blank": ("leg.json", " \n\n", ["is empty"]),
    "not utf-8": ("leg.toml", b"gravity = 9\n# 5 \xb0 more\n", ["line 2", "not UTF-8"]),
    "binary": ("leg.json", bytes(range(256)), ["line 2", "not UTF-8"]),
    "nul": ("leg.toml", "gravity = 9\n\0\n", ["line 2", "not TOML"]),
    "too large": ("leg.toml", "#" * (LARGEST + 1), [str(LARGEST), "few thousand"]),
    "truncated toml": ("leg.toml", "gravity = 9\n[thigh]\ncoulomb =", ["line 3", "not TOML", "write the file again"]),
    "torn header": ("leg.toml", "gravity = 9\n[thigh\ncoulomb = 3", ["line 2", "not TOML"]),
    "truncated json": ("leg.json", '{"gravity": 9,\n"thigh": {', ["line 2", "not JSON", "write the file again"]),
    "two documents": ("leg.json", '{"gravity": 9}\n{"gravity": 9}', ["line 2", "not JSON"]),
    "json in toml": ("leg.toml", '{"gravity": 9}', ["line 1", "not TOML"]),
    "toml in json": ("leg.json", "gravity = 9", ["line 1", "not JSON"]),
    "unknown": ("leg.toml", "[thigh]\ncoulom = 3", ["'thigh.coulom'", "did you mean thigh.coulomb", "qpal info"]),
    "unlike any": ("leg.toml", "zzz = 3", ["unknown parameter 'zzz'", "qpal info"]),
    "joint forgotten": ("leg.toml", "stroke = 0.1", ["'stroke'", "thigh.stroke", "shank.stroke"]),
    "unknown table": ("leg.toml", "[knee]\ncoulomb = 3", ["unknown table 'knee'", "shoulder", "thigh", "shank"]),
    "empty unknown table": ("leg.toml", "[knee]", ["unknown table 'knee'"]),
    "number for a joint": ("leg.json", '{"thigh": 3}', ["thigh is a table", "thigh."]),
    "list for a joint": ("leg.toml", "[[thigh]]\ncoulomb = 3", ["thigh is a table", "thigh."]),
    "table for a number": ("leg.toml", "[gravity]\nx = 3", ["gravity is a table", "one number of m/s2"]),
    "string": ("leg.toml", "gravity = '9.81'", ["gravity is '9.81'", "not a number", "0 to 20 m/s2", "quotes"]),
    "bool": ("leg.json", '{"gravity": true}', ["gravity is True", "not a number", "0 to 20 m/s2"]),
    "null": ("leg.json", '{"gravity": null}', ["gravity is None", "not a number"]),
    "date": ("leg.toml", "gravity = 2016-01-01", ["gravity is datetime", "not a number"]),
    "list": ("leg.toml", f"gravity = {[1] * 99}", ["gravity is [1, 1,", "...", "not a number"]),
    "nan": ("leg.toml", "gravity = nan", ["gravity is nan", "0 to 20 m/s2"]),
    "minus infinity": ("leg.toml", "gravity = -inf", ["gravity is -inf", "0 to 20 m/s2"]),
    "json nan": ("leg.json", '{"gravity": NaN}', ["found NaN", "finite"]),
    "json infinity": ("leg.json", '{"gravity": 1e999}', ["gravity is inf", "0 to 20 m/s2"]),
    "below": ("leg.toml", "thigh.coulomb = -1", ["thigh.coulomb is -1 N;", "give a number from 0 to "]),
    "above": (
        "leg.toml",
        "thigh.rod_angle = 4",
        ["thigh.rod_angle is 4 rad", "-3.141592653589793 to 3.141592653589793"],
    ),
    "far above": ("leg.toml", f"gravity = 1{'0' * 400}", ["gravity is 1000", "...", "0 to 20 m/s2"]),
    "digits toml": ("leg.toml", f"gravity = {'9' * 5000}", ["4300 digits"]),
    "digits json": ("leg.json", f'{{"gravity": {"9" * 5000}}}', ["4300 digits"]),
    "twice in toml": ("leg.toml", "gravity = 9\ngravity = 8\n", ["line 2", "is repeated", "keep one"]),
    "table twice": ("leg.toml", "[thigh]\n[shank]\n[thigh]\n", ["line 3", "is repeated"]),
    "twice in json": ("leg.json", '{"gravity": 9, "gravity": 8}', ["'gravity' is repeated", "keep one"]),
    "twice in two ways": ("leg.json", '{"thigh": {"coulomb": 4}, "thigh.coulomb": 5}', ["thigh.coulomb", "4.0 and 5"]),
    "json list": ("leg.json", "[1, 2]", ["found [1, 2]", "names with numbers"]),
    "deep json": ("leg.json", '{"a":' * DEEP, ["nested too deeply"]),
    "deep toml": ("leg.toml", f"a = {'[' * DEEP}", ["nested too deeply"]),
}


def sentence(path) -> str:
    with pytest.raises(InputError) as caught:
        read(path)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 100 + len(str(path)) + 200
    assert str(path) in text
    return text


@pytest.mark.parametrize(("name", "content", "fragments"), BAD.values(), ids=BAD)
def test_bad_content_is_one_sentence(name, content, fragments, tmp_path):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    text = sentence(path)
    for fragment in fragments:
        assert fragment in text


def test_bad_places_are_one_sentence(tmp_path):
    assert "does not exist" in sentence(tmp_path / "nowhere.toml")
    (tmp_path / "folder.toml").mkdir()
    assert "is a folder" in sentence(tmp_path / "folder.toml")
    os.mkfifo(tmp_path / "pipe.toml")
    assert "not a regular file" in sentence(tmp_path / "pipe.toml")  # and does not wait for a writer


def test_every_bound_that_a_sentence_names_is_accepted(tmp_path):
    path = tmp_path / "leg.toml"
    for row in TABLE:
        for bound in (row.lower, row.upper):
            path.write_text(f"{row.name} = {bound + 1e6 * (1 if bound == row.upper else -1)!r}")
            allowed = sentence(path).partition("give a number from ")[2]
            low, _, rest = allowed.partition(" to ")
            for text in (low, rest.split()[0]):
                path.write_text(f"{row.name} = {text}")
                read(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_that_cannot_be_written_is_one_sentence_and_leaves_what_was_there(suffix, tmp_path, monkeypatch):
    path = tmp_path / f"leg{suffix}"
    write(Parameters({"gravity": 5.0}), path)

    def full(file) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(InputError, match=r"cannot write .*leg.*No space left on device"):
        write(Parameters({"gravity": 6.0}), path)
    monkeypatch.undo()
    assert read(path)["gravity"] == 5.0
    assert list(tmp_path.iterdir()) == [path]
    for wrong in (tmp_path / "nowhere" / path.name, tmp_path / "leg.yaml"):
        with pytest.raises(InputError, match=wrong.name):
            write(Parameters(), wrong)
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(InputError, match="cannot write"):
        write(Parameters(), tmp_path / f"folder{suffix}")
    assert len(list(tmp_path.iterdir())) == 2


def test_the_option_names_the_file_whose_values_make_no_leg_together(tmp_path):
    path = tmp_path / "leg.toml"
    path.write_text("[shank]\nretracted_length = 0.3\n")
    assert read(path)["shank.retracted_length"] == 0.3
    with pytest.raises(InputError, match=r"leg\.toml: shank: the actuator cannot be"):
        from_option(str(path))
    path.write_text("[shank]\nretracted_length = 0.16\n")
    assert from_option(str(path)) == Parameters({"shank.retracted_length": 0.16})
    assert from_option(None) is None
