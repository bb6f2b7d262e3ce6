"""`qpal info FILE`: what a file is, the mapping to keep, the sampling, the repairs; and what reads by that mapping."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

import twin
from sysid.channels.mapping_file import read_map
from twin.cli import main

N, LOST = 400, (50, 51, 300)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A capture of a rig's board, a log of ours, and files with one fault each."""
    monkeypatch.chdir(tmp_path)
    k = np.setdiff1d(np.arange(N), LOST)
    u = np.repeat(np.random.default_rng(3).integers(-255, 256, N // 10), 10)
    y = np.zeros(N)
    for i in range(1, N):
        y[i] = 0.95 * y[i - 1] + 0.001 * u[i - 1]
    rows = np.column_stack([(65_000 + 20 * np.arange(N)) % 2**16, u, np.rint(512 + 100 * y)])
    np.savetxt("rig.csv", rows[k], fmt="%d", delimiter=",", header="millis,pwm,adc", comments="")
    np.savetxt("gap.csv", np.delete(rows, slice(100, 140), 0), fmt="%d", delimiter=",", header="t,u,y", comments="")
    np.savetxt("three.csv", rows, fmt="%d", delimiter=",", header="t,x,z", comments="")
    text = (tmp_path / "rig.csv").read_text().splitlines()
    text[20] = text[20].rpartition(",")[0] + ","
    (tmp_path / "empty.csv").write_text("\n".join(text) + "\n")
    twin.Experiment("thigh", "aprbs", duration=30.0, Ts=0.02).run().save("log.csv")
    return tmp_path


def run(arguments, capsys, code=0):
    assert main([*arguments, "--json", "--out", "out"]) == code
    out, err = capsys.readouterr()
    assert err == ""
    summary = json.loads(out)
    assert summary == json.loads(Path("out/summary.json").read_text(encoding="utf-8"))
    return summary


def test_a_capture_is_described_and_its_mapping_reads_it_the_same(folder, capsys):
    first = run(["info", "rig.csv", "--write-map", "rig.toml"], capsys)
    assert first["format"] == "Delimited"
    assert [(c["name"], c["role"], c["kind"], c["empty"]) for c in first["columns"]] == [
        ("millis", "clock", "varies", 0),
        ("pwm", "input", "varies", 0),
        ("adc", "output", "varies", 0),
    ]
    assert first["columns"][1]["low"] == min(
        int(line.split(",")[1]) for line in Path("rig.csv").read_text().splitlines()[1:]
    )
    assert first["mapping"]["clock"] == {"column": "millis", "unit": "ms", "period": 65536.0, "Ts": None}
    sampling = first["sampling"]
    assert (sampling["Ts"], sampling["samples"], sampling["largest_step"]) == (0.02, N, pytest.approx(0.06))
    assert sampling["repairs"] == {"wraps": 1, "lost": 3, "filled samples": 3}
    assert first["unclear"] == []
    assert first["problem"] is None
    assert any("'pwm' names no unit" in sentence for sentence in first["why"])
    assert {each.name for each in (folder / "out" / "figures").iterdir()} == {"channels.png", "steps.png"}
    again = run(["info", "rig.csv", "--map", "rig.toml"], capsys)
    assert again["mapping"] == read_map("rig.toml").model_dump(mode="json") == first["mapping"]
    assert again["sampling"] == first["sampling"]
    assert first["next"] == again["next"] == "qpal identify rig.csv --map rig.toml"


def test_a_person_reads_the_answer_first_and_the_next_commands(folder, capsys):
    assert main(["info", "log.csv", "--out", "out"]) == 0
    out = capsys.readouterr().out
    assert " samples ● good" in out.splitlines()[0]
    (to_edit,) = [line for line in out.splitlines() if line.startswith("To read it otherwise: ")]
    command = to_edit.removeprefix("To read it otherwise: qpal ").partition(",")[0]
    assert main([*shlex.split(command), "--out", "again"]) == 0
    assert 'column = "voltage_V"' in (folder / "log.toml").read_text(encoding="utf-8")
    capsys.readouterr()
    assert "Next: qpal identify log.csv --structure actuated_joint\n" in out  # as the first advice says
    assert "qpal compare log.csv --joint thigh" in out
    html = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "[[output]]" in html
    assert html.count("<img ") == 2


def test_what_is_unclear_ends_with_1_and_a_choice_in_the_mapping(folder, capsys):
    found = run(["info", "three.csv", "--write-map", "three.toml"], capsys, code=1)
    assert "name one with --input and one with --output" in found["unclear"][0]
    assert found["record"] is None
    text = (folder / "three.toml").read_text()
    assert "# CHOOSE one of x, z" in text
    assert main(["identify", "three.csv", "--map", "three.toml"]) == 2
    assert "set column of [[input]] to one of t, x, z" in capsys.readouterr().err
    chosen = text.replace('column = ""', 'column = "x"', 1).replace('column = ""', 'column = "z"', 1)
    (folder / "three.toml").write_text(chosen)
    assert run(["info", "three.csv", "--map", "three.toml"], capsys)["sampling"]["samples"] == N
    named = run(["info", "three.csv", "--input", "x", "--output", "z"], capsys)
    assert named["next"] == "qpal identify three.csv --input x --output z"


def test_a_file_that_is_refused_brings_the_repair_that_reads_it(folder, capsys):
    found = run(["info", "empty.csv", "--write-map", "map.toml"], capsys)
    assert "row 21, column 'adc'" in found["problem"]
    assert found["suggested_repairs"] == ["empty"]
    assert found["sampling"]["repairs"]["empty cells"] == 1
    assert read_map("map.toml").repair.empty == "fill"
    assert main(["identify", "empty.csv", "--time", "millis"]) == 2
    capsys.readouterr()
    words = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1"]
    summary = run([*found["next"].split()[1:], *words], capsys)
    assert summary["read"]["repairs"] == found["sampling"]["repairs"]
    assert summary["read"]["units"] == {"input": "", "output": "counts"}
    assert summary["fit_percent"]["validation"] > 90


def test_a_long_gap_is_refused_and_a_range_reads_one_piece(folder, capsys):
    found = run(["info", "gap.csv"], capsys, code=1)
    assert "row 102, column 't'" in found["problem"]
    assert found["problem"].endswith("with --range 2.8:7.98")
    piece = run(["info", "gap.csv", "--range", "2.8:7.98"], capsys)
    assert piece["sampling"]["samples"] == 260
    assert piece["next"] == "qpal identify gap.csv --range 2.8:7.98"


def test_a_lost_sample_is_filled_by_guess_but_not_in_a_clock_that_is_named(folder, capsys):
    words = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1"]
    assert run(["identify", "rig.csv", *words], capsys)["read"]["repairs"]["lost"] == 3
    assert main(["identify", "rig.csv", "--input", "pwm", "--output", "adc", "--time", "millis"]) == 2
    assert "row 52, column 'millis': found a step of 0.06 s where most are 0.02 s" in capsys.readouterr().err


def test_a_leg_log_s_column_keeps_its_unit(folder, capsys):
    log = twin.Experiment("leg", "aprbs", duration=40.0, Ts=0.1).run()
    log.save(folder / "leg.csv")
    columns = ["--input", "voltage_thigh_V", "--output", "angle_thigh_rad"]
    words = ["--structure", "output_error", "--orders", "2,2,1", "--starts", "1"]
    summary = run(["identify", "leg.csv", *columns, *words], capsys)
    assert summary["read"]["units"] == {"input": "V", "output": "rad"}
    assert summary["read"]["time"] == "time_s"


BAD = {
    "unit of a clock": (["info", "gap.csv", "--time", "u", "--time-unit", "V"], ["'V'", "ms"]),
    "time unit alone": (["info", "rig.csv", "--time-unit", "ms"], ["--time-unit", "--time"]),
    "map and columns": (["identify", "rig.csv", "--map", "m.toml", "--input", "pwm"], ["--input and --map"]),
    "map and ts": (["identify", "rig.csv", "--map", "m.toml", "--ts", "1"], ["--ts and --map"]),
    "no map": (["identify", "rig.csv", "--map", "m.toml"], ["m.toml", "does not exist", "--write-map"]),
    "map suffix": (["info", "rig.csv", "--write-map", "m.json"], ["m.json", ".toml"]),
    "map place": (["info", "rig.csv", "--write-map", "no/m.toml"], ["no/m.toml", "no folder"]),
    "range text": (["info", "rig.csv", "--range", "3"], ["--range is '3'", "START:STOP"]),
    "range order": (["info", "rig.csv", "--range", "3:1"], ["start is 3 s", "stop is 1 s"]),
    "range outside": (["identify", "rig.csv", "--range", "100:"], ["0 sample(s)", "from 0 to 7.98 s"]),
    "no file": (["info", "no.csv"], ["no.csv", "does not exist"]),
    "unknown column": (["info", "rig.csv", "--input", "pmw", "--output", "adc"], ["'pmw'", "closest is 'pwm'"]),
    "params of a file": (["info", "rig.csv", "--signatures"], ["--signatures", "rig.csv"]),
    "map of nothing": (["info", "--map", "m.toml"], ["--map", "without a FILE"]),
    "joint": (["info", "rig.csv", "--joint", "knee"], ["'knee'", "thigh"]),
    "view map": (["view", "--map", "m.toml"], ["--map", "without a LOG"]),
    "view in counts": (["view", "rig.csv", "--strip", "a.png"], ["'adc' is in counts", "unit", "--map"]),
}


@pytest.mark.parametrize(("arguments", "fragments"), BAD.values(), ids=BAD)
def test_bad_input_is_one_sentence_and_leaves_nothing(arguments, fragments, folder, capsys):
    before = sorted(folder.rglob("*"))
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    for fragment in fragments:
        assert fragment in err
    assert sorted(folder.rglob("*")) == before


def test_a_pixel_of_every_filled_sample_is_marked(folder):
    """The figure's marks against the record's own."""
    from sysid.channels.reading import read_signals
    from sysid.drawing.axes import draw
    from sysid.report.inspection import channels_figure, steps_figure

    signals = read_signals("rig.csv")
    for axes in draw(channels_figure(signals)):
        (marks,) = [line for line in axes.lines if line.get_label() == "filled"]
        np.testing.assert_allclose(marks.get_xdata(), 0.02 * np.array(LOST))
    (axes,) = draw(steps_figure(signals))
    assert sum(patch.get_height() for patch in axes.patches) == N - len(LOST) - 1


def test_a_mapping_that_is_not_there_is_written_first(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    lines = [f"{k / 10},{k * k % 7},{k % 5},{k % 3}" for k in range(60)]
    Path("open.csv").write_text("t,a,b,c\n" + "\n".join(lines) + "\n")
    assert main(["info", "open.csv", "--input", "a", "--out", "first"]) == 1
    assert "Next: qpal info open.csv --input a --write-map MAP.toml" in capsys.readouterr().out
    assert main(["info", "open.csv", "--input", "a", "--write-map", "MAP.toml", "--out", "second"]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "Next: fill in the lines of MAP.toml that say CHOOSE, then: qpal identify open.csv --map MAP.toml" in said


def test_a_delay_names_no_model_to_fit_next(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    u = np.random.default_rng(0).normal(size=600)
    y = u + 0.5 * np.roll(u, 1) + 0.1 * np.random.default_rng(1).normal(size=600)
    np.savetxt(
        "log.csv", np.column_stack([0.1 * np.arange(600), u, y]), delimiter=",", header="time_s,u,y", comments=""
    )
    found = run(["info", "log.csv"], capsys)
    (delay,) = (a for a in found["advice"] if a["topic"] == "delay")
    assert (delay["value"], delay["severity"]) == (0.0, "note")
    assert "--orders 2,3,0" in delay["action"]
    assert found["next"] == "qpal identify log.csv"
