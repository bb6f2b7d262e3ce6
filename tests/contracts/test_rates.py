"""Several rates in one table: a plant that is known in continuous time comes back from every shape of such a table."""

import json
from pathlib import Path

import numpy as np
import polars
import pytest
from plants_in_time import GAIN, TAU, level_at, pole_and_gain, response, steps
from scipy.io import savemat

import sysid
from sysid.base.errors import InputError
from sysid.channels.guess import Given, guess
from sysid.channels.mapping import ChannelMap
from sysid.channels.mapping_file import read_map, write_map
from sysid.channels.reading import parse_range, read_signals
from sysid.formats import read_table
from sysid.workflow.record import read_record

SECONDS, TS = 12.0, 0.02
CASES = Path(__file__).parent / "cases"  # from public reports
Series = tuple[np.ndarray, np.ndarray]


def signals_of(dwell: float, u_step: float | None, y_step: float, shift: float, seed: int = 3) -> tuple[Series, Series]:
    """Input, on change where its step is None, and output, later by `shift` [s]: times (n,) [s] and values (n,)."""
    changes, levels = steps(seed, dwell, SECONDS)
    t = changes if u_step is None else np.arange(0.0, SECONDS - 1e-9, u_step)
    t_y = np.arange(0.0, SECONDS - 1e-9, y_step) + shift
    return (t, level_at(t, changes, levels)), (t_y, response(t_y, changes, levels))


def union(u: Series, y: Series) -> dict[str, np.ndarray]:
    """One table of both: a row for each stamp, nan where a column has no value."""
    t = np.unique(np.round(np.concatenate([u[0], y[0]]), 7))
    table = {"t_s": t, "u_V": np.full(len(t), np.nan), "y_rad": np.full(len(t), np.nan)}
    for name, (times, values) in (("u_V", u), ("y_rad", y)):
        table[name][np.searchsorted(t, np.round(times, 7))] = values
    return table


def write(path: Path, table: dict[str, np.ndarray]) -> Path:
    """The table in the format of its suffix."""
    frame = polars.DataFrame(table).fill_nan(None)
    if path.suffix == ".csv":
        frame.write_csv(path)
    elif path.suffix == ".parquet":
        frame.write_parquet(path)
    elif path.suffix == ".json":
        path.write_text(json.dumps(frame.to_dicts()))
    else:
        savemat(path, table)
    return path


def told(notes: tuple[str, ...], text: str) -> bool:
    return any(text in note for note in notes)


KINDS = {  # dwell of the levels, step of the input (None: on change), step and shift of the output
    "interleaved": (0.24, 0.02, 0.02, 0.0031),
    "interleaved by most of a step": (0.24, 0.02, 0.02, 0.019),
    "on change": (0.24, None, 0.02, 0.0),
    "on change, between the samples": (0.24, None, 0.02, 0.007),
    "written four times": (3.0, None, 0.02, 0.0031),
    "slow input": (0.24, 0.12, 0.02, 0.0),
    "slow input, between the samples": (0.36, 0.12, 0.02, 0.0031),
    "slow output": (0.24, 0.005, 0.02, 0.0),
    "slow output, between the samples": (0.24, 0.002, 0.04, 0.0011),
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_plant_comes_back_and_no_sample_of_the_output_is_lost(kind, tmp_path):
    dwell, u_step, y_step, shift = KINDS[kind]
    u, y = signals_of(dwell, u_step, y_step, shift)
    record = read_signals(write(tmp_path / "a.csv", union(u, y)))
    assert (record.N, record.missing.sum()) == (len(y[0]), 0)
    assert pytest.approx(y_step, rel=1e-9) == record.Ts
    np.testing.assert_array_equal(record.output[0].values, y[1])
    assert set(record.input[0].values) <= set(u[1])  # held, never interpolated
    pole, gain = pole_and_gain(record.input[0].values, record.output[0].values)
    assert pole == pytest.approx(np.exp(-y_step / TAU), abs=1e-6)
    assert gain == pytest.approx(GAIN, abs=1e-5)
    assert told(record.notes, f"the rows are the {len(y[0])} of 'y_rad', and inputs are held")
    assert told(record.notes, f"each {shift * 1e3:.4g} ms before" if shift else "at stamps of the output's")


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".json", ".mat"])
def test_the_rule_is_one_for_every_format(suffix, tmp_path):
    u, y = signals_of(0.24, 0.02, 0.02, 0.0031)
    record = read_signals(write(tmp_path / f"a{suffix}", union(u, y)))
    assert (record.N, round(record.Ts, 9)) == (600, TS)
    np.testing.assert_allclose(record.output[0].values, y[1], rtol=1e-12)
    assert pole_and_gain(record.input[0].values, record.output[0].values)[0] == pytest.approx(np.exp(-TS / TAU))
    assert told(record.notes, "3.1 ms")


def test_signals_of_simulink_with_times_of_their_own(tmp_path):
    u, y = signals_of(0.24, 0.01, 0.02, 0.0031)
    logged = {
        name: {"time": t[:, None], "signals": {"values": x[:, None], "label": label}}
        for name, label, (t, x) in (("cmd", "u_V", u), ("joint", "angle_rad", y))
    }
    savemat(tmp_path / "a.mat", logged)
    record = read_signals(tmp_path / "a.mat")
    assert (record.N, round(record.Ts, 9), record.mapping.clock.column) == (600, TS, "joint.time")
    assert pole_and_gain(record.input[0].values, record.output[0].values)[0] == pytest.approx(np.exp(-TS / TAU))


@pytest.mark.parametrize(("dwell", "step"), [(0.233, 0.001), (0.037, 0.001), (0.007, 0.001), (0.233, None)])
def test_an_input_that_changes_anywhere_within_a_step_becomes_its_mean(dwell, step, tmp_path):
    u, y = signals_of(dwell, step, 0.02, 0.0031)
    record = read_signals(write(tmp_path / "a.csv", union(u, y)))
    held = u[1][np.searchsorted(u[0], y[0], side="right") - 1]
    pole, gain = pole_and_gain(record.input[0].values, record.output[0].values, direct=False)
    assert pole == pytest.approx(np.exp(-TS / TAU), abs=0.004)
    assert gain == pytest.approx(GAIN, rel=0.02)

    def remainder(x: np.ndarray) -> float:
        lines = np.column_stack([y[1][:-1], x[:-1]])
        return float(np.linalg.norm(y[1][1:] - lines @ np.linalg.lstsq(lines, y[1][1:], rcond=None)[0]))

    assert remainder(record.input[0].values) < 0.25 * remainder(held)
    assert told(record.notes, "the mean of each step")


def test_a_second_output_goes_along_straight_lines_and_a_far_slower_one_is_refused(tmp_path):
    u, y = signals_of(0.24, 0.02, 0.02, 0.0031)
    table = union(u, y)
    table["z_rad"] = np.full(len(table["t_s"]), np.nan)
    places = np.flatnonzero(np.isfinite(table["u_V"]))
    table["z_rad"][places] = 3.0 * table["t_s"][places]
    path = write(tmp_path / "a.csv", table)
    data = read_record(path, "u_V", "y_rad,z_rad").data
    np.testing.assert_allclose(data.y[:, 1], 3.0 * (np.arange(data.N) * TS + 0.0031), atol=1e-9)
    short = {**table, "z_rad": table["z_rad"].copy()}
    short["z_rad"][places[100:130]] = np.nan
    write(path, short)
    with pytest.raises(InputError, match=r"'z_rad': found no value for 0.62 s"):
        read_record(path, "u_V", "y_rad,z_rad")
    data = read_record(path, "u_V", "y_rad,z_rad", missing="fill").data
    assert np.asarray(data.missing).sum(axis=0).tolist() == [0, 31]  # and none of them a straight line that was made up
    table["z_rad"][places[np.arange(len(places)) % 20 > 0]] = np.nan
    with pytest.raises(InputError, match=r"'z_rad' has a value every 0.4 s and 'y_rad' every 0.02 s.*one output at a"):
        read_record(write(path, table), "u_V", "y_rad,z_rad")
    assert read_record(path, "u_V", "y_rad").data.N == 600


@pytest.mark.parametrize(("blocks", "step"), [(False, None), (True, None), (True, 0.02)])
def test_experiments_and_signals_below_each_other_are_told_apart(blocks, step, tmp_path):
    """Two experiments behind each other stay two; an input that is written below the output is no second one."""
    u, y = signals_of(0.24, step, 0.02, 0.0031)
    first = union(u, y)
    if blocks:
        is_u = np.isfinite(first["u_V"])
        order = np.concatenate([np.flatnonzero(~is_u), np.flatnonzero(is_u)])
        table = {name: values[order] for name, values in first.items()}
    else:
        second = union(*signals_of(0.24, None, 0.02, 0.0031, seed=4))
        second = {name: values[2:] for name, values in second.items()}  # it begins without a value of its input
        table = {name: np.concatenate([values, second[name]]) for name, values in first.items()}
    record = read_signals(write(tmp_path / "a.csv", table))
    assert record.lengths == (() if blocks else (600, 588))
    for lengths in ((0, 600), (600, None)) if not blocks else ((0, None),):
        u, y = (signal.values[slice(*lengths)] for signal in record.all)
        assert pole_and_gain(u, y) == pytest.approx((np.exp(-TS / TAU), GAIN), abs=1e-6)


STOPS = {"stops": (4.0, 6.0, "0:3.98 or 6.02:11.98"), "ends": (9.0, 99.0, "")}


@pytest.mark.parametrize("kind", STOPS)
def test_a_stream_that_stops_is_not_held_for_long_and_each_remedy_works(kind, tmp_path):
    first, last, pieces = STOPS[kind]
    u, y = signals_of(0.24, 0.02, 0.02, 0.0031)
    keep = (u[0] < first) | (u[0] > last)
    path = write(tmp_path / "a.csv", union((u[0][keep], u[1][keep]), y))
    if not pieces:
        record = read_signals(path)
        assert record.N == 450  # one step of the input from its last stamp
        assert told(record.notes, "150 row(s) at the ends, where another column has no value, are left out")
        return
    with pytest.raises(InputError, match=f"row 4.*'u_V': found no value for 2.0. s.*--range {pieces}, or set longest"):
        read_signals(path)
    for piece in pieces.split(" or "):
        data = read_record(path, range=parse_range(piece)).data
        assert pole_and_gain(data.u[:, 0], data.y[:, 0])[0] == pytest.approx(np.exp(-TS / TAU), abs=1e-6)
    mapping = guess(path).mapping
    mapping = mapping.model_copy(update={"repair": mapping.repair.model_copy(update={"longest_gap": 101})})
    assert read_signals(path, mapping).N == 600


def test_samples_of_the_output_that_were_lost_are_not_made_by_the_merge(tmp_path):
    u, y = signals_of(0.24, None, 0.02, 0.0031)
    few = np.ones(600, dtype=bool)
    few[[100, 200, 201]] = False
    record = read_signals(write(tmp_path / "a.csv", union(u, (y[0][few], y[1][few]))))
    assert (record.N, int(record.missing.sum()), record.counts["lost"]) == (600, 3, 3)
    many = (y[0] < 4) | (y[0] > 6)
    with pytest.raises(InputError, match=r"found a step of 2\.0. s where most are 0.02 s"):
        read_signals(write(tmp_path / "b.csv", union(u, (y[0][many], y[1][many]))))


def test_the_mapping_that_is_written_reads_the_same(tmp_path):
    u, y = signals_of(0.24, 0.02, 0.02, 0.0031)
    path = write(tmp_path / "a.csv", union(u, y))
    mapping = read_map(write_map(guess(path).mapping, tmp_path / "a.toml"))
    assert isinstance(mapping, ChannelMap)
    np.testing.assert_array_equal(read_signals(path, mapping).io().u, read_signals(path).io().u)


def test_without_a_clock_nothing_says_when_the_rows_were(tmp_path):
    """The output's own rate, or that of all rows: the answer would be wrong without a word."""
    u, y = signals_of(0.24, None, 0.02, 0.0)
    table = union(u, y)
    del table["t_s"]
    with pytest.raises(InputError, match="a sampling time alone does not say when"):
        read_record(write(tmp_path / "a.csv", table), Ts=TS)


def test_a_few_empty_cells_are_lost_samples_still(tmp_path):
    """Each row has both signals: nothing is held beyond what is told of lost samples."""
    u, y = signals_of(0.24, 0.02, 0.02, 0.0)
    table = {"t_s": u[0], "u_V": u[1].copy(), "y_rad": y[1]}
    table["u_V"][100:150] = np.nan
    path = write(tmp_path / "a.csv", table)
    with pytest.raises(InputError, match=r"row 102, column 'u_V': found an empty cell"):
        read_signals(path)


@pytest.mark.parametrize("stamped", [False, True])
def test_topics_of_a_robot_log_have_rates_of_their_own(stamped, tmp_path):
    """With stamps in both topics these are compared; with one in the output alone, the log times tell the shift."""
    writer = pytest.importorskip("mcap.writer")
    u, y = signals_of(0.24, None, 0.02, 0.0031)
    late = 0.002  # [s] by which messages of the input were received later than they were sent
    messages = [(t, "/cmd", {"u": v, **({"stamp": t - late} if stamped else {})}) for t, v in zip(*u, strict=True)]
    messages += [(t, "/joint", {"stamp": t, "angle": v, "temp": 20.0}) for t, v in zip(*y, strict=True)]
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        log = writer.Writer(file)
        log.start()
        schema = log.register_schema("m", "jsonschema", b"{}")
        channels = {topic: log.register_channel(topic, "json", schema) for topic in ("/cmd", "/joint")}
        for t, topic, content in sorted(messages, key=lambda message: message[0]):
            log.add_message(channels[topic], round(t * 1e9), json.dumps(content).encode(), 0)
        log.finish()
    table = read_table(path)
    assert table.clocks["cmd.u"] == "cmd.time"
    for given in (Given(), Given(time="joint.stamp", time_unit="s")):
        result = guess(table, given)
        assert not result.unclear
        record = read_signals(path, result.mapping)
        assert (record.N, round(record.Ts, 9)) == (600, TS)
        assert told(record.notes, "5.1 ms" if stamped and given.time else "3.1 ms")
        assert pole_and_gain(record.input[0].values, record.output[0].values)[0] == pytest.approx(np.exp(-TS / TAU))
    with pytest.raises(InputError, match=r"--time is 'cmd.time', which is not the clock of the output; name one of"):
        read_record(path, time="cmd.time")


def test_topics_of_two_joints_are_recorded_together_and_no_experiments(tmp_path):
    """They differ by a number, and in length, as each has a clock of its own."""
    writer = pytest.importorskip("mcap.writer")
    (_, u), (t, y) = signals_of(0.24, 0.02, 0.02, 0.0)
    with (tmp_path / "a.mcap").open("wb") as file:
        log = writer.Writer(file)
        log.start()
        schema = log.register_schema("m", "jsonschema", b"{}")
        for k in (1, 2):
            channel = log.register_channel(f"/joint{k}", "json", schema)
            for time, a, b in zip(t[::k], u[::k], y[::k], strict=True):
                log.add_message(channel, round(time * 1e9), json.dumps({"u": k * a, "y": k * b}).encode(), 0)
        log.finish()
    data = read_record(tmp_path / "a.mcap", "joint1.u", "joint1.y").data
    assert data.N == 600
    assert pole_and_gain(data.u[:, 0], data.y[:, 0]) == pytest.approx((np.exp(-TS / TAU), GAIN), abs=1e-6)


def test_the_case_of_a_public_report():
    """asammdf 1219: 300 rows of the angle, 3.1 ms behind 300 of the voltage."""
    data = read_record(CASES / "union.csv").data
    assert (data.N, round(data.Ts, 9), data.missing) == (300, TS, None)
    fit = sysid.fit(sysid.structures.output_error(nb=2, nf=2, nk=1), data, seed=0)
    assert np.sort(np.real(fit.poles)) == pytest.approx([0.819, 1.0], abs=0.001)
