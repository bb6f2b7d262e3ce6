"""No log is read as another one, by its name, numbers, time or columns: right, or a sentence that says why."""

import ast
import json
import re
from pathlib import Path

import numpy as np
import polars
import pytest

import sysid
import twin
from sysid import Channel, ChannelMap, InputError
from sysid.channels.guess import Given, guess
from sysid.channels.mapping import Clock
from sysid.channels.reading import from_table, read_signals
from sysid.formats import read_header, read_table, write_table
from sysid.workflow.record import read_record
from twin.ensemble.parts import Parts

K = np.arange(40)
U, Y = np.round(np.sin(K), 3), np.round(np.cos(0.3 * K), 3)


def log(head: str, *columns, mark: str = ",", above: str = "") -> str:
    """A table of texts or numbers below its names."""
    rows = (mark.join(str(cell) for cell in row) for row in zip(*columns, strict=True))
    return above + "\n".join([*([head.replace(",", mark)] if head else []), *rows]) + "\n"


def written(tmp_path: Path, text: str | bytes, name: str = "rig.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


# -- a path is a path --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["log[1].parquet", "log?.parquet", "log*.parquet", "~/log1.parquet", "[a-z]/x.parquet"]
)
def test_a_name_is_no_pattern(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    decoys = ["log1.parquet", "logx.parquet", "home/log1.parquet", "a/x.parquet"]
    for decoy in decoys:
        Path(decoy).parent.mkdir(exist_ok=True)
        write_table(decoy, {"u": U, "y": Y}, "a decoy")
    with pytest.raises(InputError, match="does not exist"):
        read_table(name)
    Path(name).parent.mkdir(exist_ok=True)
    write_table(name, {"u": -U, "y": Y}, "the log")
    assert read_table(name).numbers("u").tolist() == (-U).tolist()
    assert read_header(name) == "the log"


def test_parts_of_an_ensemble_are_those_of_its_own_folder(tmp_path):
    for folder, value in (("ens1", 1.0), ("ens[1]", 2.0)):
        parts = Parts.open(tmp_path / folder, 1, 1, {}, {}, new=True)
        parts.write(0, polars.DataFrame({"number": [0], "a": [value]}))
    (found,) = Parts.open(tmp_path / "ens[1]", 1, 1, {}, {}, new=False).read()
    assert found["a"].to_list() == [2.0]


def test_a_table_of_the_benchmark_is_that_of_its_own_name(tmp_path):
    from sysid.bench import table as bench

    content = Path(__file__).parents[1] / "bench" / "quick.parquet"
    (tmp_path / "new1.parquet").write_bytes(content.read_bytes())
    with pytest.raises(InputError, match="no results table"):
        bench.parquet(tmp_path / "new[1].parquet")


def test_every_call_that_could_take_a_name_for_a_pattern_is_told_not_to():
    """polars reads log1.parquet for log[1].parquet unless glob is False; bytes and buffers have no name."""
    calls = []
    for package in (sysid, twin):
        for path in Path(package.__path__[0]).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                name = node.func.attr if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) else ""
                if name.startswith(("read_parquet", "scan_", "read_csv", "read_ipc", "read_ndjson")):
                    calls.append((path, name, node))
    loose = [
        f"{path}:{node.lineno}"
        for path, name, node in calls
        if name != "read_parquet_metadata"
        and not any(k.arg == "glob" and getattr(k.value, "value", None) is False for k in node.keywords)
        and getattr(node.args[0], "id", "") != "block"
        and getattr(node.func.value, "id", "") != "tables"  # of base, whose own call of polars is in this list
    ]
    assert len(calls) >= 3
    assert not loose


# -- marks in numbers --------------------------------------------------------------------------------------------------

PARTED = [608, 1234, 987, 2345, 999, 1001, 12, 3500]


def parted(mark: str, values=PARTED) -> list[str]:
    return [f"{value:,}".replace(",", mark) for value in values]


@pytest.mark.parametrize("mark", [",", "."])
@pytest.mark.parametrize(("separator", "quote"), [(";", ""), ("\t", ""), (",", '"')])
def test_thousands_marks_are_no_decimal_marks(mark, separator, quote, tmp_path):
    cells = [f"{quote}{cell}{quote}" for cell in parted(mark)]
    path = written(tmp_path, log("t,u,y", range(10, 90, 10), cells, range(5, 13), mark=separator))
    with pytest.raises(InputError) as said:
        read_table(path)
    for part in ("row 3, column 'u'", repr(f"1{mark}234"), "(1.234)", "(1234)", "row 2", "'608'", "without thousands"):
        assert part in str(said.value)


@pytest.mark.parametrize("cell", ["1.234,5", "1,234.5", "1'234", "1\u2019234", "1 234", "1\u00a0234", "1,234,567"])
def test_marks_of_every_spelling_end_in_a_sentence(cell, tmp_path):
    texts = [str(u).replace(".", "," if "," in cell[-3:] else ".") for u in U]
    times = [f"{k / 10:.1f}".replace(".", "," if "," in cell[-3:] else ".") for k in K]
    texts[7] = cell
    path = written(tmp_path, log("t,u,y", times, texts, K % 5, mark=";"))
    whole = cell.translate(dict.fromkeys(map(ord, "'\u2019 \u00a0"))).replace(",", "" if "." in cell[-3:] else ".")
    meant = {"1.234,5": "1234,5", "1,234.5": "1234.5", "1,234,567": "1234567"}.get(cell, whole)
    with pytest.raises(InputError) as said:
        read_record(path)
    for part in ("row 9, column 'u'", repr(cell), "without thousands marks", meant):
        assert part in str(said.value)


CLEAR = {  # cells of a column, and its numbers
    "three decimals each": (["1,500", "2,250", "3,125"], [1.5, 2.25, 3.125]),
    "trimmed": (["1", "2,25", "3,125"], [1, 2.25, 3.125]),
    "below one": (["1,234", "0,608", "999"], [1.234, 0.608, 999]),
    "whole ones above 999": (["1,234", "1000", "608"], [1.234, 1000, 608]),
}


@pytest.mark.parametrize("cells", CLEAR)
@pytest.mark.parametrize("mark", [",", "."])
def test_decimal_marks_beyond_doubt_are_read_as_before(cells, mark, tmp_path):
    texts, right = CLEAR[cells]
    path = written(tmp_path, log("a,b", [text.replace(",", mark) for text in texts], [1, 2, 3], mark=";"))
    assert read_table(path).numbers("a").tolist() == right


def test_levels_of_a_signal_beside_numbers_beyond_doubt_are_read(tmp_path):
    """An input of two levels, 0 and 2,375, in a file whose clock has decimal commas."""
    times = [f"{k / 10:.1f}".replace(".", ",") for k in K]
    path = written(tmp_path, log("t,u,y", times, ["2,375" if k % 3 else "5" for k in K], K % 7, mark=";"))
    assert read_record(path).data.u[:3, 0].tolist() == [5, 2.375, 2.375]


# -- time --------------------------------------------------------------------------------------------------------------

TIMES = {"ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0, "hr": 3600.0, "Min": 60.0, "MS": 1e-3, "sec": 1.0}


@pytest.mark.parametrize("unit", TIMES)
@pytest.mark.parametrize("form", ["Time [{}]", "time ({})", "t [{}]", "t/{}"])
def test_the_unit_in_the_header_is_applied(unit, form, tmp_path):
    head = form.format(unit)
    path = written(tmp_path, log(f"{head};u;y", 100 * K, U, Y, mark=";"))
    assert sysid.read(path).Ts == pytest.approx(100 * TIMES[unit], rel=1e-12)
    mapping = ChannelMap(clock=Clock(column=head), input=(Channel(column="u"),), output=(Channel(column="y"),))
    assert sysid.read(path, map=mapping).Ts == pytest.approx(100 * TIMES[unit], rel=1e-12)
    said = mapping.model_copy(update={"clock": Clock(column=head, unit="s")})
    assert read_signals(path, said).Ts == 100.0  # a person has the last word
    assert unit == "sec" or any(
        f"header names {unit}".lower() in note.lower() for note in read_signals(path, said).notes
    )


@pytest.mark.parametrize("tail", ["_min", "_h"])
def test_a_word_for_time_with_a_unit_behind_it(tail, tmp_path):
    path = written(tmp_path, log(f"time{tail},u,y", K, U, Y))
    assert sysid.read(path).Ts == {"_min": 60.0, "_h": 3600.0}[tail]


@pytest.mark.parametrize("unit", ["xx", "fortnights", "samples", "ticks", "V"])
def test_an_unknown_unit_of_time_is_a_sentence(unit, tmp_path):
    path = written(tmp_path, log(f"Time [{unit}],u,y", 100 * K, U, Y))
    with pytest.raises(InputError, match=rf"'Time \[{unit}\]' may be the clock, but .*'{unit}' is no unit of time"):
        sysid.read(path)
    assert sysid.read(path, time=f"Time [{unit}]", time_unit="ms").Ts == pytest.approx(0.1)


@pytest.mark.parametrize(
    "text",
    ["time_s [ms],u,y", "millis [s],u,y", "t_ms,u,y\ns,,", "t,u_mV [V],y", "t,u,y_deg [rad]"],
)
def test_two_units_of_one_column_are_refused(text, tmp_path):
    path = written(tmp_path, log("", K / 10, U, Y, above=text + "\n"))
    with pytest.raises(InputError, match=r"has two units, \w+ and \w+; say which .*unit of \[+(clock|input|output)\]"):
        sysid.read(path)


HEADS = {"csv": "t,u,y", "own": "time_s,voltage_V,angle_rad"}


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
@pytest.mark.parametrize("Ts", [1e9, 0.2, 1e-9])
@pytest.mark.parametrize("names", HEADS.values(), ids=HEADS)
def test_a_header_that_contradicts_the_clock_is_refused(names, Ts, suffix, tmp_path):
    columns = dict(zip(names.split(","), (K / 10, U, Y), strict=True))
    path = write_table(tmp_path / f"rig{suffix}", columns, json.dumps({"Ts": Ts, "joint": "thigh"}))
    for read in (sysid.read, read_signals, twin.Log.load):
        with pytest.raises(
            InputError, match=rf"Ts is {re.escape(f'{Ts:g}')} s, and column '{names.split(',')[0]}' steps by 0.1 s"
        ):
            read(path)
    assert sysid.read(path, time=names.split(",")[0]).Ts == 0.1
    assert sysid.read(path, Ts=Ts).Ts == Ts
    assert "0.1" in from_table(read_table(path), Given(Ts=Ts)).notes[0]


@pytest.mark.parametrize("Ts", ["x", [1], True, None, 10**400, {"a": 1}, -1, 0])
def test_a_header_whose_sampling_time_is_none_is_passed_over(Ts, tmp_path):
    columns = {"time_s": K / 10, "voltage_V": U, "angle_rad": Y}
    path = write_table(tmp_path / "rig.csv", columns, json.dumps({"Ts": Ts, "joint": "thigh"}))
    assert sysid.read(path).Ts == twin.Log.load(path).Ts == 0.1


def test_a_header_that_agrees_or_stands_alone_is_taken(tmp_path):
    kept = np.delete(K, [7, 8, 20])
    lost = write_table(tmp_path / "lost.csv", {"t": kept / 10, "u": U[kept], "y": Y[kept]}, '{"Ts": 0.1}')
    coarse = written(tmp_path, '# qpal: {"Ts": 0.0033}\n' + log("t_ms,u,y", np.floor(3.3 * K), U, Y), "coarse.csv")
    assert sysid.read(lost).Ts == pytest.approx(0.1)
    assert not guess(coarse).unclear
    alone = write_table(tmp_path / "alone.csv", {"u": U, "y": Y}, '{"Ts": 0.1}')
    assert sysid.read(alone).Ts == 0.1
    still = write_table(tmp_path / "still.csv", {"time": 0 * K + 3.0, "u": U, "y": Y}, '{"Ts": 0.1}')
    with pytest.raises(InputError, match=r"Ts is 0.1 s, and column 'time', a clock by its name, does not rise"):
        sysid.read(still)
    for Ts in (1e9, 1e-300):
        path = write_table(tmp_path / "odd.csv", {"u": U, "y": Y}, json.dumps({"Ts": Ts}))
        with pytest.raises(
            InputError, match=rf"Ts is {re.escape(f'{Ts:g}')} s, which no rig has; give the right one with Ts="
        ):
            sysid.read(path)


# -- columns -----------------------------------------------------------------------------------------------------------

TURNED = ["y,u", "output,input", "out,in", "Y,U", "y [deg],u [V]", "outputs,inputs", "response,excitation", "yout,uin"]
TURNED += ["Ausgang,Eingang", "measured,drive", "speed,torque", "position,command", "foo,u", "y,foo", "y1,u1"]


@pytest.mark.parametrize("head", TURNED)
@pytest.mark.parametrize("turned", [True, False])
def test_two_named_columns_are_taken_by_their_names(head, turned, tmp_path):
    names = head.split(",")
    path = written(tmp_path, log(",".join(names if turned else names[::-1]), *((Y, U) if turned else (U, Y))))
    record = read_record(path, Ts=0.1)
    assert [record.output, record.input] == names
    assert record.data.u[:, 0].tolist() == U.tolist()


@pytest.mark.parametrize("head", ["a,b", "foo,bar", "ch1,ch2", "left,right"])
def test_two_names_that_say_nothing_are_refused(head, tmp_path):
    path, (one, two) = written(tmp_path, log(head, U, Y)), head.split(",")
    with pytest.raises(InputError, match=rf"'{one}' and '{two}' do not say which is the input; name one with input="):
        sysid.read(path, Ts=0.1)
    assert sysid.read(path, one, two, Ts=0.1).u[:, 0].tolist() == U.tolist()
    assert sysid.read(path, two, one, Ts=0.1).y[:, 0].tolist() == U.tolist()


def test_two_columns_without_names_are_input_and_output(tmp_path):
    record = read_record(written(tmp_path, log("", U, Y)), Ts=0.1)
    assert (record.input, record.output) == ("1", "2")
    np.save(tmp_path / "rig.npy", np.column_stack([U, Y]))
    assert sysid.read(tmp_path / "rig.npy", Ts=0.1).u[:, 0].tolist() == U.tolist()


@pytest.mark.parametrize("first", ["0,1", "1,2"])
def test_a_row_of_counts_above_decimals_may_be_names(first, tmp_path):
    decimals = [f"{x:.3f}" for x in U], [f"{x:.3f}" for x in Y]
    with pytest.raises(InputError, match=r"row 1: found \d, \d, which may be names or the first sample"):
        read_table(written(tmp_path, log("", *decimals, above=first + "\n")))
    assert len(read_table(written(tmp_path, log("", K, Y, above=first + "\n"))).columns[0]) == len(K) + 1


@pytest.mark.parametrize("bad", [lambda x: f"{x:.3e}".replace("e", "D"), lambda x: str(x > 0), lambda x: f"{x} V"])
def test_an_input_of_texts_is_not_passed_over_for_another_column(bad, tmp_path):
    path = written(tmp_path, log("t,u,pwm,y", K / 10, [bad(x) for x in U], np.round(U**2, 3), Y))
    with pytest.raises(InputError, match=r"column 'u' is the input by its name, but most of its cells are no numbers"):
        sysid.read(path)
    assert sysid.read(path, "pwm", "y", time="t").u[:, 0].tolist() == np.round(U**2, 3).tolist()


# -- what spreadsheets write -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("quote", ["", '"'])
@pytest.mark.parametrize(("mark", "decimal"), [(";", ","), (";", "."), (",", "."), ("\t", ","), ("|", ".")])
@pytest.mark.parametrize("head", ["t,u,y", ""])
def test_the_line_in_which_excel_names_its_separator(head, mark, decimal, quote, tmp_path):
    cells = [[f"{x:.2f}".replace(".", decimal) for x in column] for column in (K / 10, U, Y)]
    path = written(tmp_path, log(head, *cells, mark=mark, above=f"{quote}sep={mark}{quote}\n"))
    table = read_table(path)
    assert table.numbers(table.names[1]).tolist() == np.round(U, 2).tolist()
    assert list(table.rows[0]) == list(range(3 if head else 2, len(K) + (3 if head else 2)))


@pytest.mark.parametrize("cell", ["#N/A", "#DIV/0!", "#REF!"])
def test_an_error_of_a_spreadsheet_is_no_comment(cell, tmp_path):
    texts = [str(u) for u in U]
    texts[7] = cell
    with pytest.raises(InputError, match=f"row 9, column 'u': found '{cell}'"):
        sysid.read(written(tmp_path, log("u,y", texts, Y)), Ts=0.1)


def test_letters_of_windows_are_those_letters(tmp_path):
    text = log("t,u \u20ac,y \u201eq\u201c", K / 10, U, Y).encode("cp1252")
    assert read_table(written(tmp_path, text)).names == ("t", "u \u20ac", "y \u201eq\u201c")


def test_numbers_at_the_end_of_the_range_are_refused_without_a_warning(tmp_path):
    """Differences of such numbers overflow."""
    with pytest.raises(InputError, match="column 'u': found a value above 1e100"):
        sysid.read(written(tmp_path, log("u,y", 1e308 * np.sign(U), Y)), Ts=0.1)


def test_columns_of_a_controller_are_asked_for(tmp_path):
    """The PID library of Arduino calls the measured value Input and what drives the plant Output."""
    path = written(tmp_path, log("time,Setpoint,Input,Output", K / 10, np.repeat(1.0, len(K)), Y, U))
    with pytest.raises(
        InputError, match="may be a controller's, whose input is the output of the plant; name the input"
    ):
        sysid.read(path)
    data = sysid.read(path, input="Output", output="Input")
    np.testing.assert_allclose(data.u[:, 0], U, atol=1e-6)
