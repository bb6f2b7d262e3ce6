"""The mapping file: what is written is read again, and every bad entry is one sentence with its place."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sysid import Channel, ChannelMap, InputError
from sysid.channels.mapping import Adc, Clock, Range, Repair
from sysid.channels.mapping_file import map_text, read_map, write_map
from sysid.channels.reading import sample
from sysid.data.table import Table

NUMBERS = st.floats(-1e6, 1e6).filter(lambda x: abs(x) > 1e-6)
PAIRS = st.tuples(NUMBERS, NUMBERS).filter(lambda pair: pair[0] != pair[1])
ADCS = st.one_of(st.builds(Adc, counts=PAIRS, value=PAIRS), st.builds(Adc, bits=st.integers(1, 32), value=PAIRS))
CHANNELS = st.builds(
    Channel,
    column=st.text(min_size=1, max_size=12).filter(lambda text: not any(0xD800 <= ord(c) <= 0xDFFF for c in text)),
    name=st.sampled_from(["", "angle", 'a "quoted" \\ name', "Winkel °", "\x7f"]),
    unit=st.sampled_from(["", "V", "deg", "°", "counts"]),
    scale=NUMBERS,
    offset=NUMBERS,
    sign=st.sampled_from([1, -1]),
    adc=st.none() | ADCS,
    signed=st.sampled_from([0, 8, 16, 24, 32]),
    times=st.sampled_from(["", "supply"]),
    between=st.sampled_from(["", "held", "line"]),
)
MAPS = st.builds(
    ChannelMap,
    clock=st.builds(
        Clock,
        column=st.just("t"),
        unit=st.sampled_from(["s", "ms", "us", "ns", "min"]),
        period=st.sampled_from([None, 1000.0, 65536.0]),
        Ts=st.none() | st.floats(1e-6, 1e3),
    ),
    input=st.lists(CHANNELS, max_size=3).map(tuple),
    output=st.lists(CHANNELS, max_size=3).map(tuple),
    other=st.lists(CHANNELS, max_size=1).map(tuple),
    repair=st.builds(
        Repair,
        duplicates=st.sampled_from(["first", "mean", "refuse"]),
        backward=st.sampled_from(["refuse", "drop"]),
        jitter=st.floats(0, 0.49),
        empty=st.sampled_from(["refuse", "fill"]),
        longest_gap=st.integers(0, 1000),
        most_lost=st.floats(0, 1),
    ),
    range=st.builds(Range, start=st.none() | st.floats(-10, 0), stop=st.none() | st.floats(1, 10)),
)


@given(mapping=MAPS, title=st.text(max_size=30))
def test_what_is_written_is_read_again(mapping, title, tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "rig.toml"
    assert read_map(write_map(mapping, path, title.encode("ascii", "ignore").decode())) == mapping


def test_every_entry_of_the_file_has_a_comment():
    mapping = ChannelMap(clock=Clock(column="t"), input=(Channel(column="u"),), output=(Channel(column="y"),))
    lines = [line for line in map_text(mapping).splitlines() if re.match(r"(# )?\w+ = .*", line)]
    entries = [line for line in lines if not line.startswith("# value")]
    assert all(len(line.split("  # ", 1)[1]) > 10 for line in entries)
    named = {line.removeprefix("# ").split(" = ")[0] for line in entries}
    models = (Clock, Channel, Repair, Range)
    assert named == {name for model in models for name in model.model_fields}


@given(channel=CHANNELS, codes=st.lists(st.integers(0, 1), min_size=4, max_size=4), supply=st.floats(1, 20))
def test_a_channel_is_its_formula(channel, codes, supply):
    """value = sign (scale x + offset), x through word, adc and the other column, from the definition in words."""
    x = np.array(codes, dtype=float)
    table = Table(Path("a.csv"), (channel.column, "supply"), (x, np.full(4, supply)), (range(1, 5),) * 2)
    if channel.column == "supply":
        return
    mapping = ChannelMap(clock=Clock(Ts=1.0), input=(channel,))
    found = sample(table, mapping).input[0]
    expected = []
    for code in codes:
        value = float(code)
        if channel.adc is not None:
            low, high = channel.adc.counts or (0, 2**channel.adc.bits - 1)
            share = (value - low) / (high - low)
            value = channel.adc.value[0] * (1 - share) + channel.adc.value[1] * share
        value *= supply if channel.times else 1.0
        value = channel.sign * (channel.scale * value + channel.offset)
        expected.append(np.deg2rad(value) if channel.unit in ("deg", "°") else value)
    size = 1e-9 * (np.abs(expected).max() + abs(channel.offset) + abs(channel.scale) * supply * 1e6)
    np.testing.assert_allclose(found.values, expected, rtol=1e-9, atol=size)
    assert found.unit == {"deg": "rad", "°": "rad"}.get(channel.unit, channel.unit)


BAD = {
    "no toml": ("clock\n", ["line 1", "not TOML", "--write-map"]),
    "unclosed": ('[clock]\ncolumn = "t\n', ["line 2", "not TOML"]),
    "twice": ('[clock]\nunit = "s"\nunit = "ms"\n', ["line 3", "not TOML"]),
    "table": ('[clok]\ncolumn = "t"\n', ["line 1", "'clok'", "closest is 'clock'"]),
    "entry": ('[clock]\ncolum = "t"\n', ["line 2, table [clock]", "'colum'", "closest is 'column'"]),
    "entry of the second channel": (
        '[[input]]\ncolumn = "a"\n[[input]]\ncolumn = "b"\nscal = 2\n',
        ["line 5, table [input]", "'scal'", "'scale'"],
    ),
    "unit of the clock": ('[clock]\nunit = "V"\n', ["line 2, table [clock]", "'V'", "ms"]),
    "the old name of period": (
        '[clock]\ncolumn = "t"\nwrap = 16\n',
        ["line 3", "wrap is now period", "period = 65536"],
    ),
    "period without a column": ("[clock]\nperiod = 60\n", ["table [clock]", "period is 60", "name the column"]),
    "Ts": ("[clock]\nTs = 0\n", ["line 2", "Ts is 0", "at least 1e-12"]),
    "Ts text": ('[clock]\nTs = "10 ms"\n', ["line 2", "'10 ms'", "a number"]),
    "one bracket": ('[input]\ncolumn = "u"\n', ["line 1", "[[input]]"]),
    "no column": ('[[input]]\nunit = "V"\n', ["line 1, table [input]", "column is missing"]),
    "column number": ("[[input]]\ncolumn = 3\n", ["line 2", "column is 3", "text in quotes"]),
    "scale text": ('[[input]]\ncolumn = "u"\nscale = "3"\n', ["line 3", "'3'", "a number"]),
    "scale nan": ('[[input]]\ncolumn = "u"\nscale = nan\n', ["line 3", "nan", "finite"]),
    "scale true": ('[[input]]\ncolumn = "u"\nscale = true\n', ["line 3", "True", "a number"]),
    "scale 0": ('[[input]]\ncolumn = "u"\nscale = 0\n', ["table [input]", "scale is 0", "constant"]),
    "sign": ('[[input]]\ncolumn = "u"\nsign = 2\n', ["line 3", "sign is 2", "1 or -1"]),
    "between": ('[[input]]\ncolumn = "u"\nbetween = "spline"\n', ["line 3", "'spline'", '"held"']),
    "adc number": ('[[output]]\ncolumn = "y"\nadc = 10\n', ["line 3", "adc is 10", "a table"]),
    "adc without value": ('[[output]]\ncolumn = "y"\nadc = {bits = 10}\n', ["line 3", "value is missing"]),
    "adc both": (
        '[[output]]\ncolumn = "y"\nadc = {bits = 10, counts = [0, 1], value = [0, 1]}\n',
        ["line 3", "counts or bits"],
    ),
    "adc one point": (
        '[[output]]\ncolumn = "y"\nadc = {counts = [5, 5], value = [0, 1]}\n',
        ["line 3", "two different"],
    ),
    "adc flat": ('[[output]]\ncolumn = "y"\nadc = {bits = 8, value = [1, 1]}\n', ["line 3", "two different values"]),
    "adc three": ('[[output]]\ncolumn = "y"\nadc = {counts = [0, 1, 2], value = [0, 1]}\n', ["line 3", "two numbers"]),
    "adc bits": (
        '[[output]]\ncolumn = "y"\nadc = {bits = 64, value = [0, 1]}\n',
        ["line 3", "bits is 64", "at most 32"],
    ),
    "gap": ("[repair]\nlongest_gap = 1.5\n", ["line 2, table [repair]", "1.5", "whole number"]),
    "gap below 0": ("[repair]\nlongest_gap = -1\n", ["line 2", "-1", "at least 0"]),
    "jitter": ("[repair]\njitter = 0.7\n", ["line 2", "0.7", "below 0.5"]),
    "duplicates": ('[repair]\nduplicates = "last"\n', ["line 2", "'last'", '"first"']),
    "range": ("[range]\nstart = 3\nstop = 2\n", ["table [range]", "start is 3 s", "before the stop"]),
    "empty": ("\n", ["is empty", "--write-map"]),
    "bytes": (b"[clock]\n# \xff\n", ["line 2", "UTF-8"]),
    "Ts of no converter": ("[clock]\nTs = 5e-324\n", ["line 2", "Ts is 5e-324", "at least 1e-12"]),
    "Ts beyond years": ("[clock]\nTs = 1e300\n", ["line 2", "Ts is 1e+300", "at most 1e+12"]),
    "several clocks": ('[[clock]]\ncolumn = "t"\n', ["line 1", "[[clock]]", "write [clock]"]),
    "true for 1": ('[[input]]\ncolumn = "u"\nsign = true\n', ["line 3, table [input]", "sign is True", "give 1 or -1"]),
    "false for 0": (
        '[[input]]\ncolumn = "t"\nsigned = false\n',
        ["line 3", "signed is False", "give 0, 8, 16, 24 or 32"],
    ),
    "scale beyond numbers": (
        '[[input]]\ncolumn = "u"\nscale = 1e308\n',
        ["line 3", "scale is 1e+308", "at most 1e+151"],
    ),
    "adc beyond numbers": (
        '[[output]]\ncolumn = "y"\nadc = {counts = [-1e308, 1e308], value = [0, 1]}\n',
        ["line 3", "counts is -1e+308", "at least -1e+151"],
    ),
    "adc of one value": (
        '[[output]]\ncolumn = "y"\nadc = {bits = 10, value = [1]}\n',
        ["line 3", "value has 1 number(s)", "two numbers"],
    ),
    "adc list": ('[[output]]\ncolumn = "y"\nadc = [{bits = 10, value = [0, 1]}]\n', ["line 3", "adc is", "a table"]),
    "times itself": ('[[input]]\ncolumn = "u"\ntimes = "u"\n', ["line 3", "times is 'u'", "the column itself"]),
    "long": ("[clock]\n" + 5000 * "a" + " = 3\n", ["line 2", "unknown entry 'aaa", "aaa...'; choose one of"]),
    "deep": ("a = " + 3000 * "[", ["rig.toml"]),
}


@pytest.mark.parametrize(("text", "fragments"), BAD.values(), ids=BAD)
def test_a_bad_mapping_is_one_sentence_with_its_place(text, fragments, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as found:
        read_map(path)
    said = str(found.value)
    assert said.startswith(str(path))
    assert "\n" not in said
    assert ";" in said or "one of the two: {" in said
    for fragment in fragments:
        assert fragment in said


@pytest.mark.parametrize(("name", "said"), [("rig.json", r"end its name in \.toml"), ("none.toml", "does not exist")])
def test_a_mapping_that_is_no_toml_file(name, said, tmp_path):
    (tmp_path / "rig.json").write_text("{}")
    with pytest.raises(InputError, match=said):
        read_map(tmp_path / name)
    with pytest.raises(InputError, match="is a folder"):
        read_map(tmp_path)


def test_a_bad_entry_in_python_is_the_same_sentence():
    with pytest.raises(InputError, match="unknown entry 'scal'; the closest is 'scale'"):
        Channel(column="u", scal=3)
    with pytest.raises(InputError, match="counts is"):
        Channel(column="u", adc={"counts": [0, 1, 2], "value": [0, 1]})


def test_a_mapping_without_its_channels(tmp_path):
    table = Table(tmp_path / "a.csv", ("t", "u"), (np.arange(9.0), np.arange(9.0)), (range(1, 10),) * 2)
    u, empty = Channel(column="u"), Channel(column="")
    for mapping, said in (
        (ChannelMap(clock=Clock(column="t")), "has no channel"),
        (
            ChannelMap(clock=Clock(column="t"), input=(u,), output=(empty,)),
            r"set column of \[\[output\]\] to one of t, u",
        ),
        (ChannelMap(clock=Clock(column="t"), input=(u,), output=(u,)), "given as input and as output"),
        (ChannelMap(input=(u,)), "no sampling time"),
        (ChannelMap(clock=Clock(column="t"), input=(Channel(column="U"),)), r"\(input.column of the mapping\).* 'u'"),
        (ChannelMap(clock=Clock(column="t"), input=(Channel(column="u", times="v"),)), "input.times of the mapping"),
    ):
        with pytest.raises(InputError, match=said):
            sample(table, mapping)
    with pytest.raises(InputError, match="the mapping has no output"):
        sample(table, ChannelMap(clock=Clock(column="t"), input=(u,))).io()


STEPS = np.array([0.0, 1.0, 3.0, 2.0, 5.0, 4.0, 7.0, 6.0, 9.0, 8.0])


def table(tmp_path, t=None, **more):
    columns = {"t": np.arange(10) * 0.01 if t is None else t, "u": STEPS, "y": STEPS[::-1].copy(), **more}
    return Table(tmp_path / "a.csv", tuple(columns), tuple(columns.values()), (range(1, 11),) * len(columns))


def mapped(**changed):
    parts = {"clock": Clock(column="t"), "input": (Channel(column="u"),), "output": (Channel(column="y"),)}
    return ChannelMap(**parts | changed)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"input": (Channel(column="u"), Channel(column="u", scale=2.0))},
            "column 'u' is given twice as input; name two",
        ),
        ({"output": (Channel(column="y"), Channel(column="y"))}, "column 'y' is given twice as output; name two"),
        ({"output": (Channel(column="u"),)}, "column 'u' is given as input and as output; name two"),
        ({"input": (Channel(column="t"),)}, "column 't' is given as the clock and as input; name two"),
        ({"input": (Channel(column="u", times="t"),)}, "times of the mapping is the clock 't'; name another"),
        ({"range": Range(active="t")}, r"active of \[range\] is the clock 't'; name another"),
    ],
)
def test_a_column_is_one_thing(changed, said, tmp_path):
    with pytest.raises(InputError, match=said):
        sample(table(tmp_path), mapped(**changed))
    aside = mapped(other=(Channel(column="u"), Channel(column="u", scale=2.0)))  # kept beside the record, for looking
    assert np.array_equal(sample(table(tmp_path), aside).other[1].values, 2.0 * STEPS)


def test_channels_of_one_name_are_told_by_column(tmp_path):
    twins = mapped(input=(Channel(column="u", name="a"),), output=(Channel(column="y", name="a"),))
    record = sample(table(tmp_path), twins)
    assert [record.input[0].name, record.output[0].name] == ["u", "y"]
    assert "2 channels have the name 'a'; they are told by column" in record.notes
    units = mapped(input=(Channel(column="u [V]"), Channel(column="u [A]")))
    record = sample(table(tmp_path, **{"u [V]": STEPS, "u [A]": STEPS**2}), units)
    assert [signal.name for signal in record.input] == ["u [V]", "u [A]"]


def test_no_name_and_no_unit_steers_a_terminal(tmp_path):
    odd = mapped(input=(Channel(column="u", name="a\x1b[31m", unit="\x1b]0;x\x07"),))
    (signal,) = sample(table(tmp_path), odd).input
    assert (signal.name, signal.unit) == (r"a\x1b[31m", r"\x1b]0;x\x07")


@pytest.mark.parametrize(
    "channel",
    [
        {"adc": {"counts": [0, 1e-320], "value": [0, 1]}},
        {"times": "v", "scale": 1e151},
    ],
)
def test_a_calibration_that_makes_no_number_is_told_with_its_row(channel, tmp_path):
    vast = table(tmp_path, v=np.full(10, 1e99), u=1e99 * STEPS)
    with pytest.raises(
        InputError, match=r"row \d+, column 'u': found .*, of which adc, times, scale .* make (inf|nan)"
    ):
        sample(vast, mapped(input=(Channel(column="u", **channel),)))


def test_empty_cells_of_either_column_are_no_fault_of_the_calibration(tmp_path):
    holed, supply = STEPS.copy(), np.full(10, 2.0)
    holed[3], supply[6] = np.nan, np.nan
    scaled = mapped(input=(Channel(column="u", times="v", scale=3.0),), repair=Repair(empty="fill", most_lost=0.5))
    record = sample(table(tmp_path, u=holed, v=supply), scaled)
    assert record.counts["empty cells"] == 2
    assert record.input[0].values[9] == 6.0 * STEPS[9]


def test_a_sampling_time_far_below_that_of_the_stamps_is_told_as_such(tmp_path):
    with pytest.raises(InputError, match=r"Ts of \[clock\] is 0.001 s and most steps of column 't' are 0.01 s, and"):
        sample(table(tmp_path), mapped(clock=Clock(column="t", Ts=0.001)))


@pytest.mark.parametrize(
    ("clock", "last", "samples"),
    [(Clock(column="t", Ts=1e-9), 0.09, "90,000,001"), (Clock(column="t"), 1e9, "100,000,000,001")],
)
def test_no_memory_is_taken_for_samples_that_nobody_recorded(clock, last, samples, tmp_path):
    t = np.append(np.arange(9) * 0.01, last)
    repair = Repair(longest_gap=10**15, most_lost=1.0, jitter=0.49)
    with pytest.raises(InputError, match=rf"10 stamps would become {samples} samples, .* at most 10,000 "):
        sample(table(tmp_path, t), mapped(clock=clock, repair=repair))
    fine = Clock(column="t", Ts=1e-12)
    jittered = np.arange(10) * 0.01 + 1e-5 * np.sin(np.arange(10.0))
    with pytest.raises(InputError, match=r"stamps would become .* samples"):
        sample(table(tmp_path, jittered), mapped(clock=fine, repair=repair))
