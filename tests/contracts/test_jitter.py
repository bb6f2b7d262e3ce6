"""Time stamps that are not where the samples were, and samples that were not taken at equal steps, with the truth."""

from pathlib import Path

import numpy as np
import pytest

import sysid
from sysid.channels.guess import guess
from sysid.channels.jitter import sampled_at_stamps
from sysid.channels.mapping import Channel, ChannelMap, Clock
from sysid.channels.reading import read_signals, sample
from sysid.data.table import Table
from sysid.workflow.record import read_record

TS, N, HOLD, NOISE = 0.01, 1000, 10, 0.002


def loop(seed, size, steady):
    """Stamps, input and output of a loop, and its pole: a lag whose input changes at a row.

    A `steady` loop ran every TS and its stamps are off by `size` of a step; another one ran at its stamps.
    """
    rng = np.random.default_rng(seed)
    tau = np.exp(rng.uniform(np.log(0.03), np.log(0.3)))
    stamps = np.sort(TS * (np.arange(N) + size * rng.standard_normal(N)))
    times = TS * np.arange(N) if steady else stamps
    u, y = np.repeat(rng.uniform(-1.0, 1.0, N // HOLD), HOLD), np.zeros(N)
    for k, a in enumerate(np.exp(-np.diff(times) / tau)):
        y[k + 1] = a * y[k] + (1.0 - a) * 2.0 * u[k]
    return stamps - stamps[0], u, y + NOISE * rng.standard_normal(N), np.exp(-TS / tau)


def read(t, u, y, **options):
    columns = {"t": t, "u": u, "y": y}
    table = Table(Path("log.csv"), tuple(columns), tuple(columns.values()), (range(2, len(t) + 2),) * 3)
    mapping = ChannelMap(clock=Clock(column="t", **options), input=[Channel(column="u")], output=[Channel(column="y")])
    return sample(table, mapping)


def fit_of(record):
    """The free-run fit [%] of a lag, and its pole."""
    data = record.io()
    fit = sysid.fit(sysid.structures.output_error(1, 1, 1), data, starts=1)
    return fit.fit_percent(data), abs(complex(fit.poles[0]))


@pytest.mark.parametrize(("size", "steady"), [(0.02, True), (0.1, True), (0.02, False), (0.1, False)])
def test_a_lag_is_recovered_from_a_log_whose_stamps_jitter(size, steady):
    """With the input held at the grid alone the fit was 85 to 93 % and the pole off by some 0.003."""
    for seed in range(3):
        *log, pole = loop(seed, size, steady)
        percent, found = fit_of(read(*log))
        assert percent > 98.5
        assert found == pytest.approx(pole, abs=6e-4)


def test_rows_of_a_steady_loop_are_its_samples_and_those_of_another_one_are_not():
    for seed in range(10):
        t, u, y, _ = loop(seed, 0.1, steady=True)
        made = read(t, u, y)
        assert (made.N, made.Ts) == (N, TS)
        np.testing.assert_array_equal(made.output[0].values, y)
        np.testing.assert_array_equal(made.input[0].values, u)
        assert any("rows are taken as samples" in note for note in made.notes)
        assert read(*loop(seed, 0.1, steady=False)[:3]).sampling.interpolated


def test_what_the_stamps_say_of_the_samples():
    """Without noise the two are told apart exactly, across lost rows too; a constant output says nothing."""
    rng = np.random.default_rng(1)
    index = np.delete(np.arange(300), [50, 51, 200])
    t = TS * (index + 0.1 * rng.standard_normal(len(index)))
    late, even = np.sin(3.0 * t), np.sin(3.0 * TS * index)
    assert sampled_at_stamps(t, index, TS, [late])
    assert not sampled_at_stamps(t, index, TS, [even])
    assert sampled_at_stamps(t, index, TS, [np.where(index > 250, np.nan, late), np.zeros(len(t))])
    assert not sampled_at_stamps(t, index, TS, [np.zeros(len(t))])
    assert not sampled_at_stamps(t, index, TS, [])


def test_a_lost_row_among_stamps_that_jitter_is_filled_where_it_was():
    t, u, y, _ = loop(4, 0.1, steady=True)
    made = read(*(np.delete(each, [123, 404]) for each in (t, u, y)))
    np.testing.assert_array_equal(np.flatnonzero(made.missing), [123, 404])
    np.testing.assert_array_equal(made.output[0].values[405:], y[405:])


def test_a_held_input_becomes_its_mean_over_each_step_of_a_grid():
    """Where deviations add up: the integral of the input stays what it was, up to the last step."""
    rng = np.random.default_rng(7)
    t = np.concatenate([[0.0], np.cumsum(TS * rng.uniform(0.6, 1.4, N - 1))])
    u = np.repeat(rng.uniform(-1.0, 1.0, N // HOLD), HOLD)
    made = read(t, u, np.cos(t))
    assert made.sampling.interpolated
    fine = np.linspace(0.0, made.N * made.Ts, 200 * made.N, endpoint=False) + made.Ts / 400
    held = u[np.searchsorted(t, fine, side="right") - 1]
    np.testing.assert_allclose(made.input[0].values, held.reshape(made.N, 200).mean(axis=1), atol=0.011)
    assert any("by their mean over each step" in note for note in made.notes)


def lost(path, step, unit, places, n=400):
    """A log of n rows every `step` [s] without those at `places`, as loggers write it."""
    k = np.delete(np.arange(n), places)
    u = np.repeat(np.random.default_rng(3).uniform(-1.0, 1.0, n // 5), 5)
    y = np.cumsum(u)
    header = "time,u,y" if unit == "s" else f"time_{unit},u,y"
    factor = 1.0 if unit == "s" else 1e3
    rows = [f"{factor * step * i:.7g},{u[i]:.6g},{y[i]:.6g}" for i in k]
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("unit", ["s", "ms"])
@pytest.mark.parametrize("step", [0.001, 0.002, 0.01, 0.02, 0.1])
def test_two_lost_rows_are_no_rounding(tmp_path, step, unit):
    """Stamps of a few decimals: no uniform clock, rounded, stands so, and the two rows are filled."""
    made = read_signals(lost(tmp_path / "log.csv", step, unit, [103, 234]))
    assert made.Ts == pytest.approx(step, rel=1e-6)
    np.testing.assert_array_equal(np.flatnonzero(made.missing), [103, 234])


def test_what_a_rounded_clock_shows_too_is_refused(tmp_path):
    """Two steps of two at a quarter and three quarters: a clock 0.5 % slower, rounded, stands exactly so."""
    path = lost(tmp_path / "log.csv", 0.01, "s", [100, 300])
    with pytest.raises(sysid.InputError, match=r"too coarse to tell a lost sample from rounding; .* or as Ts beside"):
        read_signals(path)
    mapping = guess(path).mapping
    clock = mapping.clock.model_copy(update={"Ts": 0.01})  # as the sentence says
    made = read_signals(path, mapping.model_copy(update={"clock": clock}))
    np.testing.assert_array_equal(np.flatnonzero(made.missing), [100, 300])
    assert read_record(path, Ts=0.01).data.N == 398  # and for a rounded clock


def own_clocks(path, last, shift=0.0):
    """u every 50 ms up to `last` [s] and y every 10 ms to 8 s, with clocks of their own."""
    t_u, t_y = np.arange(0.0, last + 1e-9, 0.05) + shift, np.arange(801) * 0.01
    u = np.repeat(np.random.default_rng(2).uniform(-1.0, 1.0, 100), 2)[: len(t_u)]
    rows = [f"{t!r},{v:.4f}" for t, v in zip(t_u.tolist(), u, strict=True)] + [","] * (len(t_y) - len(t_u))
    body = [f"{row},{t:.2f},{np.sin(t):.5f}" for row, t in zip(rows, t_y, strict=True)]
    path.write_text("\n".join(["t_u,u,t_y,y", *body]) + "\n", encoding="utf-8")
    return read_record(path)


def test_an_input_that_ends_early_is_known_for_one_more_step(tmp_path):
    record = own_clocks(tmp_path / "log.csv", last=5.95)
    assert record.data.N == 601  # up to 6.00 s
    assert any("200 row(s) at the ends" in note for note in record.notes)


def test_clocks_that_are_equal_but_for_their_last_digit_are_one(tmp_path):
    record = own_clocks(tmp_path / "log.csv", last=8.0, shift=1e-15)
    assert any("at stamps of the output's" in note for note in record.notes)
    levels = np.unique(np.round(record.data.u, 4))
    assert len(levels) <= 81 + 1  # no means between levels


def test_a_sampling_time_that_is_no_whole_ratio_takes_means_too():
    """From 0.01 s to 0.015 s: a step that spans a switch has the part of each level, so no switch comes late."""
    t, u, y, _ = loop(2, 0.0, steady=True)
    made = read(t, u, y, Ts=0.015)
    exact = np.repeat(u, 2)[: 3 * (2 * N // 3)].reshape(-1, 3).mean(axis=1)
    np.testing.assert_allclose(made.input[0].values[: len(exact) - 1], exact[:-1], atol=1e-9)
