"""Several experiments in one file: a clock that starts again, a column that numbers them; and what is none."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from plants_in_time import first_order

import sysid
from sysid.base.errors import InputError
from sysid.channels.mapping_file import read_map
from sysid.workflow.inspection import inspect_file
from sysid.workflow.record import read_record
from twin.cli import main

CASES = Path(__file__).parent / "cases"
CHANNELS_OF_PARTS = '\n[[input]]\ncolumn = "u_V"\n[[output]]\ncolumn = "y_rad"\n'


def parts(lengths):
    return [first_order(n, k) for k, n in enumerate(lengths)]


def write(path, header, records, row, mark=","):
    """A file with the rows row(number of the experiment, sample) + (u, y) of each record."""
    lines = [mark.join(header)]
    for k, (u, y) in enumerate(records):
        lines += [mark.join(f"{value:.7g}" for value in (*row(k, i), u[i], y[i])) for i in range(len(u))]
    path.write_text("\n".join(lines) + "\n")
    return path


SIBLINGS = {
    "restart alone": (["t_s", "u_V", "angle_rad"], lambda k, i: (0.02 * i,), ","),
    "milliseconds, never at 0, semicolons": (["t_ms", "u_V", "angle_rad"], lambda k, i: (7 + 10 * i,), ";"),
    "trial column first, time goes on": (["trial", "t_s", "u_V", "y_rad"], lambda k, i: (k + 1, 0.02 * i + 9 * k), ","),
    "test numbers and a restart, tabs": (["test_no", "time_us", "u_V", "y_rad"], lambda k, i: (5 - k, 2500 * i), "\t"),
    "time goes on without a gap": (["t_s", "experiment_id", "u_V", "y_rad"], lambda k, i: (0.1 * (60 * k + i), k), ","),
}


STEPS = {
    "restart alone": 0.02,
    "milliseconds, never at 0, semicolons": 0.01,
    "test numbers and a restart, tabs": 0.0025,
}


@pytest.mark.parametrize("name", SIBLINGS)
@pytest.mark.parametrize("clock", ["used", "not used"])
def test_experiments_are_read_one_by_one(name, clock, tmp_path):
    """Also where the sampling time is given, so that the clock is not used."""
    header, row, mark = SIBLINGS[name]
    records = parts((60, 60, 60))
    given = {"Ts": STEPS.get(name, 0.02)} if clock == "not used" else {}
    record = read_record(write(tmp_path / "a.csv", header, records, row, mark), **given)
    assert not any("the first of -" in note for note in record.notes)
    assert record.data.lengths == (60, 60, 60)
    for part, (u, y) in zip(record.data.experiments, records, strict=True):
        np.testing.assert_allclose(part.u[:, 0], u, atol=1e-6)
        np.testing.assert_allclose(part.y[:, 0], y, atol=1e-6)
    assert any("holds 3 experiments" in note and "rows 62 to 121" in note for note in record.notes)


@pytest.mark.parametrize("header", ["trial", "run"])
def test_experiments_that_have_names(header, tmp_path):
    records = parts((60, 80, 60))
    path = write(tmp_path / "a.csv", [header, "t_s", "u_V", "y_rad"], records, lambda k, i: (k, 0.02 * i + 9 * k))
    lines = path.read_text().splitlines()
    words = {"0": "slow", "1": "fast", "2": "a b"}
    path.write_text("\n".join([lines[0], *(words[line[0]] + line[1:] for line in lines[1:])]) + "\n")
    assert read_record(path).data.lengths == (60, 80, 60)
    path.write_text(path.read_text().replace(header, "label", 1))
    (tmp_path / "m.toml").write_text('[range]\nexperiment = "label"\npart = 2\n')
    data = read_record(path, mapping=tmp_path / "m.toml").data
    np.testing.assert_allclose(data.y[:, 0], records[1][1], atol=1e-6)


def test_the_episodes_of_a_robot():
    record = read_record(CASES / "episodes.parquet", input="action[0]", output="observation.state[0]")
    assert record.data.lengths == (150, 150, 150, 150)
    fit = sysid.fit(sysid.structures.output_error(nb=1, nf=1, nk=1), record.data, starts=1)
    assert -fit.theta[fit.model.names.index("linear.f1")] == pytest.approx(0.7165, abs=1e-3)


def test_a_part_and_a_range_of_each(tmp_path):
    records = parts((60, 80))
    path = write(tmp_path / "a.csv", ["t_s", "u_V", "y_rad"], records, lambda k, i: (0.02 * i,))
    (tmp_path / "m.toml").write_text("[range]\npart = 2\n")
    data = read_record(path, mapping=tmp_path / "m.toml").data
    np.testing.assert_allclose(data.y[:, 0], records[1][1], atol=1e-6)
    (tmp_path / "m.toml").write_text("[range]\npart = 3\n")
    with pytest.raises(InputError, match="give 1 to 2"):
        read_record(path, mapping=tmp_path / "m.toml")
    cut = sysid.read(path, start=0.2, stop=0.6)
    assert cut.lengths == (21, 21)
    np.testing.assert_allclose(cut.y[21:, 0], records[1][1][10:31], atol=1e-6)


def test_no_repair_and_no_sampling_time_joins_rows_over_a_restart(tmp_path):
    """Neither as advised and written, nor as asked for."""
    path = write(tmp_path / "a.csv", ["ms", "u_V", "y_rad"], parts((50, 50, 50)), lambda k, i: (20 * i,))
    for given in ({}, {"Ts": 0.02}):
        with pytest.raises(InputError, match="starts again at rows 52, 102, each time after 1000"):
            read_record(path, **given)
    found = inspect_file(path)
    assert found.mapping.repair.backward == "refuse"
    written = tmp_path / "m.toml"
    main(["info", str(path), "--write-map", str(written)])
    assert 'backward = "drop"' not in written.read_text()
    counter = written.read_text().replace("# period = 1000.0", "period = 1000")
    for remedy, lengths in ((counter, (150,)), ('[range]\nexperiment = "ms"\n', (50, 50, 50))):
        written.write_text(remedy)
        data = read_record(path, mapping=written).data
        assert data.lengths == lengths
        np.testing.assert_allclose(data.y[:, 0], np.concatenate([y for _, y in parts((50, 50, 50))]), atol=1e-6)
    with pytest.raises(InputError) as told:
        read_record(path, Ts=0.05)
    way = re.search(r'column = "" and Ts = 0.05', str(told.value))
    assert way
    written.write_text("[clock]\n" + way[0].replace(" and ", "\n") + CHANNELS_OF_PARTS)
    data = read_record(path, mapping=written).data
    assert (data.Ts, data.lengths) == (0.05, (150,))
    written.write_text(
        '[clock]\ncolumn = "ms"\nunit = "ms"\n[[input]]\ncolumn = "u_V"\n[[output]]\ncolumn = "y_rad"\n'
        '[repair]\nbackward = "drop"\n'
    )
    with pytest.raises(InputError, match="counter that wraps, or another experiment"):
        sysid.read_signals(path, read_map(written))


def one_file(kind, path, records):
    """The records as a program writes several: lists of tests in JSON, structs and cells in MATLAB."""
    tests = [{"t": (0.02 * np.arange(len(u))).tolist(), "u": u.tolist(), "y": y.tolist()} for u, y in records]
    arrays = [{name: np.array(values) for name, values in test.items()} for test in tests]
    if kind == "a list":
        path.write_text(json.dumps([{"name": f"no. {k}", **test} for k, test in enumerate(tests)]))
    elif kind == "a list with samples":
        samples = [[dict(zip("tuy", row, strict=True)) for row in zip(*test.values(), strict=True)] for test in tests]
        path.write_text(
            json.dumps({"rig": "A", "tests": [{"id": k, "samples": each} for k, each in enumerate(samples)]})
        )
    elif kind == "objects":
        path.write_text(json.dumps({f"trial_{k}": test for k, test in enumerate(tests)}))
    elif kind == "a line each":
        path.write_text("\n".join(json.dumps({"episode": k, **test}) for k, test in enumerate(tests)))
    elif kind == "a struct array":
        structs = np.zeros(len(tests), dtype=[(name, object) for name in "tuy"])
        for k, test in enumerate(arrays):
            structs[k] = tuple(test.values())
        scipy.io.savemat(path, {"tests": structs})
    elif kind == "structs":
        scipy.io.savemat(path, {f"run{k}": test for k, test in enumerate(arrays)})
    else:
        cells = np.empty(len(tests), dtype=object)
        cells[:] = arrays
        scipy.io.savemat(path, {"exp": cells, "rate": 50.0})
    return path


KINDS = {
    **dict.fromkeys(("a list", "a list with samples", "objects"), ".json"),
    "a line each": ".jsonl",
    **dict.fromkeys(("a struct array", "structs", "cells"), ".mat"),
}


@pytest.mark.parametrize("lengths", [(60, 80, 100), (70, 70, 70)])
@pytest.mark.parametrize("kind", KINDS)
def test_a_program_that_writes_several_experiments(kind, lengths, tmp_path):
    records = parts(lengths)
    record = read_record(one_file(kind, tmp_path / f"a{KINDS[kind]}", records))
    assert record.data.lengths == lengths
    for part, (u, y) in zip(record.data.experiments, records, strict=True):
        np.testing.assert_allclose(part.u[:, 0], u, atol=1e-12)
        np.testing.assert_allclose(part.y[:, 0], y, atol=1e-12)


def test_what_is_recorded_together_is_one_experiment(tmp_path):
    """Two joints of one log, and samples with vectors."""
    records = parts((70, 70))
    t = 0.02 * np.arange(70)
    joints = {f"joint{k}": {"t": t, "u": u, "y": y} for k, (u, y) in enumerate(records)}
    scipy.io.savemat(tmp_path / "a.mat", joints)
    record = read_record(tmp_path / "a.mat", input="joint1.u", output="joint1.y", Ts=0.02)
    assert record.data.lengths == (70,)
    np.testing.assert_allclose(record.data.u[:, 0], records[1][0], atol=1e-12)
    samples = [
        {"t": float(t[k]), "goal": [u[k] for u, _ in records] * 6, "angle": [y[k] for _, y in records] * 6}
        for k in range(70)
    ]
    (tmp_path / "a.json").write_text(json.dumps(samples))
    record = read_record(tmp_path / "a.json", input="goal[1]", output="angle[1]")
    assert record.data.lengths == (70,)


NEIGHBOURS = {
    "one stamp back": lambda t: np.where(np.arange(len(t)) == 70, t[50], t),
    "one stamp at 0": lambda t: np.where(np.arange(len(t)) == 70, 0.0, t),
    "two stamps at the start": lambda t: np.where(np.isin(np.arange(len(t)), (70, 71)), t - t[70], t),
}


@pytest.mark.parametrize("name", NEIGHBOURS)
def test_a_clock_that_glitches_once_is_one_experiment(name, tmp_path):
    t = NEIGHBOURS[name](np.arange(150) * 0.02)
    path = write(tmp_path / "a.csv", ["t_s", "u_V", "y_rad"], parts((150,)), lambda k, i: (t[i],))
    with pytest.raises(InputError, match="time must increase"):
        read_record(path)
    assert inspect_file(path).signals.lengths == ()


def test_columns_that_only_look_like_experiments(tmp_path):
    """A switch called run, and a number that returns."""
    for header, row in (
        (["run", "t_s", "u_V", "y_rad"], lambda k, i: (float(i >= 30), 0.02 * i)),
        (["trial", "t_s", "u_V", "y_rad"], lambda k, i: (i // 20 % 2, 0.02 * i)),
    ):
        path = write(tmp_path / "a.csv", header, parts((100,)), row)
        assert read_record(path, input="u_V", output="y_rad").data.lengths == (100,)


@pytest.mark.parametrize(("count", "N"), [(10, 10), (12, 10), (60, 20)])
@pytest.mark.parametrize("episode", [True, False])
def test_steps_of_more_episodes_than_each_has(count, N, episode, tmp_path):
    """A column that counts row by row and starts again never tells runs apart that take turns."""
    records = parts((N,) * count)
    header, row = ["step", "u", "y"], lambda k, i: (i,)
    if episode:
        header, row = ["episode", *header], lambda k, i: (k, i)
    record = read_record(write(tmp_path / "a.csv", header, records, row), Ts=0.05)
    assert record.data.lengths == (N,) * count
    np.testing.assert_allclose(record.data.y[:, 0], np.concatenate([y for _, y in records]), atol=1e-6)


@pytest.mark.parametrize("name", ["attempt", "Messung", "batch", "iteration", "ep", "source_file"])
def test_more_names_of_columns_that_number_experiments(name, tmp_path):
    records = parts((60, 80, 60))
    path = write(tmp_path / "a.csv", ["t_s", name, "u", "y"], records, lambda k, i: (0.02 * (100 * k + i), k + 1))
    assert read_record(path, input="u", output="y").data.lengths == (60, 80, 60)


@pytest.mark.parametrize("name", ["label", "id", "seq"])
def test_a_column_of_long_stretches_is_told_with_the_entry_that_parts(name, tmp_path):
    records = parts((60, 80, 60))
    starts = (0, 60, 140)
    path = write(tmp_path / "a.csv", ["t_s", name, "u", "y"], records, lambda k, i: (0.02 * (starts[k] + i), k + 1))
    record = read_record(path, input="u", output="y")
    assert record.data.lengths == (200,)
    assert any(f'set experiment = "{name}" under [range]' in note for note in record.notes)
    main(["info", str(path), "--input", "u", "--output", "y", "--write-map", str(tmp_path / "m.toml")])
    mapping = (tmp_path / "m.toml").read_text().replace('experiment = ""', f'experiment = "{name}"')
    (tmp_path / "m.toml").write_text(mapping)
    assert read_record(path, mapping=tmp_path / "m.toml").data.lengths == (60, 80, 60)


def motors(path, name, later, decimals=4):
    """Rows of two motors in turns, the second `later` [s] than the first; and what was recorded of each."""
    records = parts((100, 100))
    lines = [f"time,{name},voltage,speed"]
    for i in range(100):
        for k, (u, y) in enumerate(records):
            lines.append(f"{0.02 * i + k * later:.{decimals}f},{k + 1},{u[i]:.7g},{y[i]:.7g}")
    path.write_text("\n".join([*lines, ""]))
    return records


@pytest.mark.parametrize("later", [0.0, 0.001])
@pytest.mark.parametrize("name", ["motor_id", "joint", "node"])
@pytest.mark.parametrize("given", [{}, {"Ts": 0.02}])
def test_two_motors_in_turns(later, name, given, tmp_path):
    """Each has an even clock of its own, and all rows as they stand have none."""
    records = motors(tmp_path / "a.csv", name, later)
    record = read_record(tmp_path / "a.csv", input="voltage", output="speed", **given)
    assert record.data.lengths == (100, 100)
    assert not any("set back" in note for note in record.notes)
    for part, (u, y) in zip(record.data.experiments, records, strict=True):
        np.testing.assert_allclose(part.u[:, 0], u, atol=1e-6)
        np.testing.assert_allclose(part.y[:, 0], y, atol=1e-6)


def test_a_column_that_alternates_beside_an_even_clock_parts_nothing(tmp_path):
    motors(tmp_path / "a.csv", "phase", 0.01)
    assert read_record(tmp_path / "a.csv", input="voltage", output="speed").data.lengths == (200,)


def with_switch(path, name, words):
    """100 rows of which rows 20 to 79 are on, in these words (off, on)."""
    u, y = first_order(100, 8)
    lines = [f"{0.02 * i:.2f},{u[i]:.7g},{y[i]:.7g},{words[20 <= i < 80]}" for i in range(100)]
    path.write_text("\n".join([f"t_s,u_V,y_rad,{name}", *lines, ""]))
    return u[20:80], y[20:80]


@pytest.mark.parametrize("words", [("False", "True"), ("off", "ON"), ("0", "1")])
def test_a_switch_in_words_is_read_as_one_in_numbers(words, tmp_path):
    u, y = with_switch(tmp_path / "a.csv", "enabled", words)
    (tmp_path / "m.toml").write_text('[range]\nactive = "enabled"\n')
    for given in ({}, {"mapping": tmp_path / "m.toml"}):
        record = read_record(tmp_path / "a.csv", **given)
        np.testing.assert_allclose(record.data.u[:, 0], u, atol=1e-6)
        np.testing.assert_allclose(record.data.y[:, 0], y, atol=1e-6)
        assert not any("is not used" in note for note in record.notes)


def test_an_input_of_true_and_false(tmp_path):
    u = np.repeat(np.random.default_rng(9).random(10) > 0.5, 10)
    lines = [f"{0.02 * i:.2f},{u[i]},{np.sin(0.1 * i):.7g}" for i in range(100)]
    (tmp_path / "a.csv").write_text("\n".join(["t_s,heater_on,temp", *lines, ""]))
    data = read_record(tmp_path / "a.csv", input="heater_on", output="temp").data
    np.testing.assert_array_equal(data.u[:, 0], u)


def test_states_in_words_are_told_with_the_entry_that_parts(tmp_path):
    _, y = with_switch(tmp_path / "a.csv", "state", ("IDLE", "RUN"))
    record = read_record(tmp_path / "a.csv")
    assert any('set experiment = "state" under [range]' in note and "3 stretches" in note for note in record.notes)
    (tmp_path / "m.toml").write_text('[range]\nexperiment = "state"\npart = 2\n')
    record = read_record(tmp_path / "a.csv", mapping=tmp_path / "m.toml")
    np.testing.assert_allclose(record.data.y[:, 0], y, atol=1e-6)
    assert not any("is not used" in note for note in record.notes)
