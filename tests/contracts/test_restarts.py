"""Where a clock starts again: no repair and no sampling time joins rows over it; what came out of order is no start."""

import numpy as np
import pytest
from plants_in_time import first_order

import sysid
from sysid.base.errors import InputError
from sysid.channels.restarts import restarts
from sysid.workflow.record import read_record
from twin.cli import main


def write(path, t, u, y, decimals=4):
    rows = [f"{a:.{decimals}f},{b:.7g},{c:.7g}" for a, b, c in zip(t, u, y, strict=True)]
    path.write_text("\n".join(["t_s,u_V,y_rad", *rows, ""]))
    return path


def two(path, first, second):
    """Two runs of 100 and 80 rows with these stamps, and what was recorded."""
    (u, y), (v, z) = first_order(100, 1), first_order(80, 2)
    write(path, np.concatenate([first, second]), np.concatenate([u, v]), np.concatenate([y, z]))
    return (u, v), (y, z)


def check_two(record, u, y):
    assert record.data.lengths == (100, 80)
    for part, first, second in zip(record.data.experiments, u, y, strict=True):
        np.testing.assert_allclose(part.u[:, 0], first, atol=1e-6)
        np.testing.assert_allclose(part.y[:, 0], second, atol=1e-6)


T, LATER = np.arange(100) * 0.05, np.arange(80) * 0.05


@pytest.mark.parametrize("start", [0.3, 1.0, 2.5, 4.0, 4.85])
@pytest.mark.parametrize("given", [{}, {"Ts": 0.05}])
def test_a_second_run_may_start_later_than_the_first(start, given, tmp_path):
    u, y = two(tmp_path / "a.csv", T, start + LATER)
    check_two(read_record(tmp_path / "a.csv", **given), u, y)
    main(["info", str(tmp_path / "a.csv"), "--write-map", str(tmp_path / "m.toml")])
    check_two(read_record(tmp_path / "a.csv", mapping=tmp_path / "m.toml"), u, y)
    mapping = (tmp_path / "m.toml").read_text().replace('backward = "refuse"', 'backward = "drop"')
    (tmp_path / "m.toml").write_text(mapping)
    check_two(read_record(tmp_path / "a.csv", mapping=tmp_path / "m.toml"), u, y)


def test_runs_of_events_are_not_joined(tmp_path):
    """Their stamps have no even step, so that they are no record; but dropping rows makes none of two."""
    rng = np.random.default_rng(4)
    t = np.concatenate([np.cumsum(rng.exponential(0.05, n)) + k for n, k in ((100, 0.0), (80, 1.0))])
    assert restarts(t).tolist() == [100]


def test_a_clock_that_was_set_back_is_told_with_a_way_to_one_record(tmp_path):
    u, y = first_order(200, 3)
    path = write(tmp_path / "a.csv", np.arange(200) * 0.02 - np.where(np.arange(200) >= 90, 0.5, 0.0), u, y)
    record = read_record(path)
    assert record.data.lengths == (90, 110)
    (note,) = [note for note in record.notes if "set back" in note]
    assert "falls back at row 92" in note
    (tmp_path / "m.toml").write_text(
        '[clock]\nTs = 0.02\n[[input]]\ncolumn = "u_V"\n[[output]]\ncolumn = "y_rad"\nunit = "rad"\n'
    )
    data = read_record(path, mapping=tmp_path / "m.toml").data
    np.testing.assert_allclose(data.y[:, 0], y, atol=1e-6)
    assert data.lengths == (200,)


ORDERS = {
    "rows written twice": lambda k: np.concatenate([k[:90], k[70:90], k[90:]]),
    "packets out of order": lambda k: np.concatenate([k[:40], k[60:80], k[40:60], k[80:]]),
    "two rows exchanged": lambda k: np.concatenate([k[:50], k[51:52], k[50:51], k[52:]]),
}


@pytest.mark.parametrize("name", ORDERS)
def test_rows_out_of_order_are_no_experiments(name, tmp_path):
    u, y = first_order(150, 5)
    k = ORDERS[name](np.arange(150))
    rng = np.random.default_rng(6)
    path = write(tmp_path / "a.csv", k * 0.02, u[k], y[k] + 0.01 * rng.normal(size=150)[k])
    with pytest.raises(InputError, match='backward = "drop"'):
        read_record(path)
    if name == "rows written twice":
        (tmp_path / "m.toml").write_text('[repair]\nbackward = "drop"\n')
        data = read_record(path, mapping=tmp_path / "m.toml").data
        np.testing.assert_allclose(data.u[:, 0], u, atol=1e-6)
        assert data.lengths == (150,)


@pytest.mark.parametrize("given", [{}, {"Ts": 0.05}])
def test_runs_behind_long_pauses_are_experiments(given, tmp_path):
    """A pause longer than the runs on both sides holds more samples than were recorded."""
    u, y = two(tmp_path / "a.csv", T, 60.0 + LATER)
    check_two(read_record(tmp_path / "a.csv", **given), u, y)


def test_a_shorter_pause_is_refused_with_the_longest_piece(tmp_path):
    u, y = two(tmp_path / "a.csv", T, 7.0 + LATER)
    with pytest.raises(InputError, match=r"; keep the longest piece, 100 of 180 rows, with --range 0:4.95$"):
        read_record(tmp_path / "a.csv")
    (tmp_path / "m.toml").write_text('[range]\nexperiment = "t_s"\n')
    check_two(read_record(tmp_path / "a.csv", mapping=tmp_path / "m.toml"), u, y)
    (tmp_path / "m.toml").write_text("[repair]\nlongest_gap = 60\nmost_lost = 0.5\n")
    assert read_record(tmp_path / "a.csv", mapping=tmp_path / "m.toml").data.lengths == (221 - 1,)


def test_a_clock_set_back_by_a_round_number_is_no_counter(tmp_path):
    """It shows more than the counter could."""
    t = np.arange(180) * 1.0
    u, y = first_order(180, 7)
    path = write(tmp_path / "a.csv", t - np.where(np.arange(180) >= 100, 60.0, 0.0), u, y)
    assert sysid.read(path).lengths == (100, 80)


@pytest.mark.parametrize("begins", [0.0, 1.0, 30.0])
def test_names_that_stand_again_where_a_log_begins_are_no_row(begins, tmp_path):
    """The clock starts again, goes on, or goes on behind a pause: as without the names."""
    path = tmp_path / "a.csv"
    two(path, 0.01 * np.arange(100), begins + 0.01 * np.arange(80))
    lines = path.read_text().splitlines()
    expected = read_record(path).data
    path.write_text("\n".join([*lines[:101], lines[0], *lines[101:], ""]))
    record = read_record(path)
    assert record.data.lengths == expected.lengths == ((100, 80) if begins != 1.0 else (180,))
    np.testing.assert_array_equal(record.data.y, expected.y)
    assert any("left out 1 row(s) that hold the names again (row 102)" in note for note in record.notes)
