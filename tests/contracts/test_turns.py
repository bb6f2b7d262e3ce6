"""Motors that take turns in the rows of one log, and runs whose pause is shorter than their step."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.channels.mapping import ChannelMap
from sysid.channels.reading import read_signals
from sysid.channels.run_columns import _evenness
from sysid.workflow.record import read_record

TS, N = 0.02, 300


def motor(rng, n=N):
    u = np.repeat(rng.uniform(-1.0, 1.0, -(-n // 10)), 10)[:n]
    return u, lfilter([0.0, 0.2], [1.0, -0.9], u)


def write(path, head, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=head, comments="", fmt="%.9g")
    return path


def pole(data):
    """By least squares over rows whose neighbours are of the same experiment."""
    X, z = [], []
    for e in data.experiments:
        X.append(np.column_stack([e.y[:-1, 0], e.u[:-1, 0]]))
        z.append(e.y[1:, 0])
    return np.linalg.lstsq(np.concatenate(X), np.concatenate(z), rcond=None)[0][0]


def turns(path, name, phase=0.5, jitter=0.002, clock=True, seed=0):
    """Two motors row by row, the second `phase` of a step later: at one half all rows together have an even clock."""
    rng = np.random.default_rng(seed)
    (u1, y1), (u2, y2) = motor(rng), motor(rng)
    t = (np.arange(N)[:, None] + [0.0, phase]) * TS + jitter * rng.random((N, 2))
    columns = [np.tile([1, 2], N), np.ravel([u1, u2], "F"), np.ravel([y1, y2], "F")]
    return write(path, f"{'t,' * clock}{name},u,y", *([t.ravel()] if clock else []), *columns)


@pytest.mark.parametrize("name", ["motor", "motor_id", "id", "servo", "joint_index"])
@pytest.mark.parametrize("Ts", [None, TS])
def test_motors_that_take_turns_on_an_even_clock_are_experiments(name, Ts, tmp_path):
    record = read_record(turns(tmp_path / "log.csv", name), Ts=Ts)
    assert record.data.lengths == (N, N)
    assert pole(record.data) == pytest.approx(0.9, abs=1e-6)
    assert f"the rows of 2 experiments stand among each other: they were parted by column {name!r}" in record.notes


def test_motors_that_take_turns_without_a_clock_are_experiments(tmp_path):
    record = read_record(turns(tmp_path / "log.csv", "motor", clock=False), Ts=TS)
    assert record.data.lengths == (N, N)
    assert pole(record.data) == pytest.approx(0.9, abs=1e-6)


def test_a_signal_that_changes_row_by_row_parts_nothing(tmp_path):
    """A column of another name, and a motor's level without an even clock of its own."""
    rng = np.random.default_rng(1)
    u, y = motor(rng)
    for name, values in (("level", np.tile([1, 2], N // 2)), ("motor", rng.integers(0, 2, N))):
        path = write(tmp_path / "log.csv", f"t,{name},u,y", TS * np.arange(N), values, u, y)
        assert read_record(path).data.lengths == (N,)


def runs(path, pause, number):
    """Four runs of 150 rows, `pause` steps apart, with a column that numbers them or without."""
    rng = np.random.default_rng(2)
    u, y = np.concatenate([np.column_stack(motor(rng, 150)) for _ in range(4)]).T
    t = TS * (np.arange(600) + (pause - 1.0) * (np.arange(600) // 150))
    return write(path, f"t,{'run,' * number}u,y", t, *([np.arange(600) // 150] if number else []), u, y)


@pytest.mark.parametrize("pause", [0.3, 0.7])
def test_a_clock_that_was_set_ahead_between_runs_is_told_beside_ts(pause, tmp_path):
    record = read_record(runs(tmp_path / "log.csv", pause, False), Ts=TS)
    (note,) = [each for each in record.notes if "shorter step(s)" in each]
    assert f"'t' has 3 shorter step(s), the first of {pause * TS:g} s to row 152" in note


def test_the_column_that_the_note_asks_for_gives_the_pole_back(tmp_path):
    path = runs(tmp_path / "log.csv", 0.35, True)
    mapping = {
        "clock": {"Ts": TS},
        "input": [{"column": "u"}],
        "output": [{"column": "y"}],
        "range": {"experiment": "run"},
    }
    data = read_signals(path, ChannelMap.model_validate(mapping)).io()
    assert data.lengths == (150, 150, 150, 150)
    assert pole(data) == pytest.approx(0.9, abs=1e-6)


@pytest.mark.parametrize("rows", [11, 12])
def test_a_log_of_few_rows_is_read_beside_ts(rows, tmp_path):
    _, y = motor(np.random.default_rng(4), rows)
    path = write(tmp_path / "log.csv", "t,u,y", TS * np.arange(rows), np.arange(rows) % 3, y)
    assert len(read_record(path, Ts=TS).data.y) == rows


@pytest.mark.parametrize("kind", ["even", "jitter", "drift", "lost", "coarse"])
def test_clocks_of_one_run_are_not_told_so(kind, tmp_path):
    rng = np.random.default_rng(3)
    u, y = motor(rng)
    k = np.arange(N)
    if kind == "lost":
        k = np.flatnonzero(rng.random(N) > 0.02)
    t = TS * {"jitter": k + 0.3 * rng.random(len(k)), "drift": k * (1 + 1e-4 * k)}.get(kind, k.astype(float))
    t = np.round(t, 1 if kind == "coarse" else 6)
    path = write(tmp_path / "log.csv", "t,u,y", t, u[: len(k)], y[: len(k)])
    assert not any("shorter step(s)" in note for note in read_record(path, Ts=TS).notes)


def test_stamps_at_the_end_of_the_numbers_are_no_warning():
    with np.errstate(all="raise"):
        assert _evenness(np.array([1.0, 1.0, -1.7e308, 1.7e308, 1.7e308, 1.7e308])) < 0.9
