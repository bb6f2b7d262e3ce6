"""The stated rules of reading a log, each against a record with a known answer."""

import numpy as np
import pytest
from rig_tables import table

from sysid import Channel, ChannelMap, InputError
from sysid.channels.conversion import convert
from sysid.channels.mapping import Adc, Clock, Range, Repair
from sysid.channels.reading import from_table, parse_range, sample
from sysid.channels.repair import Correction, total

RNG = np.random.default_rng


def tuy(clock: Clock, repair: Repair | None = None, range: Range | None = None) -> ChannelMap:
    """Columns t, u [V], y [rad]."""
    u, y = Channel(column="u", unit="V"), Channel(column="y", unit="rad")
    return ChannelMap(clock=clock, input=(u,), output=(y,), repair=repair or Repair(), range=range or Range())


def ramp(k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """u and y that name their sample: u = k, y = 0.001 k."""
    return 1.0 * k, 0.001 * k


@pytest.mark.parametrize(
    ("text", "unit", "factor"),
    [
        ("deg", "rad", np.pi / 180),
        ("°", "rad", np.pi / 180),
        ("Degrees", "rad", np.pi / 180),
        ("mrad", "rad", 1e-3),
        ("rev", "rad", 2 * np.pi),
        ("rpm", "rad/s", 2 * np.pi / 60),
        ("°/s", "rad/s", np.pi / 180),
        ("mV", "V", 1e-3),
        ("Volt", "V", 1.0),
        ("kV", "V", 1e3),
        ("ms", "s", 1e-3),
        ("µs", "s", 1e-6),
        ("min", "s", 60.0),
        ("1/s", "1/s", 1.0),
        ("%", "share", 0.01),
        ("m/s²", "m/s^2", 1.0),
        ("Nm", "N*m", 1.0),
        ("LSB", "counts", 1.0),
        ("rad", "rad", 1.0),
    ],
)
def test_a_unit_becomes_si(text, unit, factor):
    found = convert(text)
    assert (found.unit, found.known) == (unit, True)
    assert found.factor == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize("text", ["", "furlong", "u", "t", "MV", "grad", "9**9**9", "s s s s s s", "V;W", "raw"])
def test_a_text_that_is_no_unit_of_a_rig_stays_as_it_is(text):
    found = convert(text)
    assert (found.unit, found.factor, found.known) == (text, 1.0, False)


@pytest.mark.parametrize("bits", [16, 32])
@pytest.mark.parametrize(("unit", "step"), [("ms", 20), ("us", 5000)])
def test_a_counter_that_starts_again_is_undone(bits, unit, step):
    k = np.arange(500)
    stamps = 2**bits - 7 * step + 3 + k * step
    counter = np.mod(stamps, 2**bits)
    u, y = ramp(k)
    for made in (
        sample(table(t=counter, u=u, y=y), tuy(Clock(column="t", unit=unit, period=2.0**bits))),
        from_table(table({"t": unit}, t=counter, u=u, y=y)),
    ):
        assert made.Ts == pytest.approx(step * {"ms": 1e-3, "us": 1e-6}[unit], rel=1e-12)
        np.testing.assert_array_equal(made.input[0].values, u)
        assert made.counts == {"wraps": stamps[-1] // 2**bits}


def test_a_counter_that_wraps_many_times():
    k = np.arange(3000)
    u, y = ramp(k)
    made = from_table(table(millis=np.mod(100 * k, 2**16), u=u, y=y))
    assert made.N == 3000
    assert made.Ts == pytest.approx(0.1, rel=1e-12)
    assert made.counts == {"wraps": 300_000 // 2**16}


def test_a_counter_that_was_reset_is_no_wrap_but_another_experiment():
    k = np.arange(100)
    millis = np.where(k < 50, 30_000 + 20 * k, 20 * (k - 50))
    assert from_table(table(millis=millis, u=k % 7, y=k % 5)).lengths == (50, 50)


def test_a_number_outside_the_counter_is_refused_with_its_row():
    clock = Clock(column="t", unit="ms", period=65536)
    with pytest.raises(InputError, match=r"row 4, column 't': found 70000 in a counter that starts again after 65536"):
        sample(table(t=[1, 2, 70000, 4], u=[1, 2, 3, 4], y=[1, 2, 3, 4]), tuy(clock))


@pytest.mark.parametrize(("how", "value"), [("first", 10.0), ("mean", 10.5)])
def test_rows_of_one_stamp(how, value):
    k = np.insert(np.arange(100), 11, 10)  # stamp 10 twice, with 10 and 11 as its inputs
    u = np.insert(np.arange(100.0), 11, 11.0)
    made = sample(table(t=0.01 * k, u=u, y=u), tuy(Clock(column="t"), Repair(duplicates=how)))
    assert made.N == 100
    assert made.input[0].values[10] == value
    np.testing.assert_array_equal(np.delete(made.input[0].values, 10), np.delete(np.arange(100.0), 10))
    assert made.counts == {"duplicates": 1}
    with pytest.raises(InputError, match=r"row 13, column 't': found 0.1 s again"):
        sample(table(t=0.01 * k, u=u, y=u), tuy(Clock(column="t"), Repair(duplicates="refuse")))


def test_a_clock_too_coarse_for_its_samples_is_refused():
    k = np.arange(300)
    with pytest.raises(InputError, match=r"row 3, column 't': found 0 s again, as 100 of 300 stamps are"):
        sample(table(t=np.floor(k / 1.5), u=k, y=k), tuy(Clock(column="t", unit="ms")))
    coarse = np.floor(1.4 * k)  # steps of 1 and 2 ms: a lost sample cannot be told from rounding
    with pytest.raises(InputError, match=r"too coarse to tell a lost sample from rounding; give .*--ts"):
        sample(table(t=coarse, u=k, y=k), tuy(Clock(column="t", unit="ms")))


def test_a_stamp_that_runs_back_is_refused_or_its_row_dropped():
    k = np.arange(60)
    t = 0.1 * k
    t[20] = 0.5
    u, y = ramp(k)
    with pytest.raises(InputError, match=r"row 22, column 't': found 0.5 s after 1.9 s \(1 such"):
        sample(table(t=t, u=u, y=y), tuy(Clock(column="t")))
    made = sample(table(t=t, u=u, y=y), tuy(Clock(column="t"), Repair(backward="drop")))
    assert made.counts == {"backward": 1, "lost": 1, "filled samples": 1}
    assert made.N == 60
    np.testing.assert_array_equal(np.flatnonzero(made.missing), [20])
    assert (made.input[0].values[20], made.output[0].values[20]) == (19.0, pytest.approx(0.020))
    t = 0.1 * k
    t[20] = 99.0  # one stamp too far ahead: that row goes, not those behind it
    made = sample(table(t=t, u=u, y=y), tuy(Clock(column="t"), Repair(backward="drop")))
    assert (made.N, made.counts["backward"]) == (60, 1)
    np.testing.assert_array_equal(np.flatnonzero(made.missing), [20])


def test_lost_samples_are_filled_and_marked_up_to_the_limit():
    k = np.delete(np.arange(200), [30, 90, 91, 92])
    u, y = ramp(k)
    made = sample(table(t=5.0 + 0.02 * k, u=u, y=y), tuy(Clock(column="t")))
    assert (made.N, made.Ts, made.sampling.start) == (200, 0.02, 5.0)
    np.testing.assert_array_equal(np.flatnonzero(made.missing), [30, 90, 91, 92])
    np.testing.assert_array_equal(made.input[0].values[[29, 30, 89, 90, 91, 92, 93]], [29, 29, 89, 89, 89, 89, 93])
    np.testing.assert_allclose(made.output[0].values, 0.001 * np.arange(200), atol=1e-12)
    assert made.counts == {"lost": 4, "filled samples": 4}
    data = made.io()
    assert data.missing is not None
    np.testing.assert_array_equal(np.flatnonzero(data.missing[:, 0]), [30, 90, 91, 92])
    with pytest.raises(InputError, match=r"row 91, column 't': found a step of 0.08 s .* at most 2 in a row") as said:
        sample(table(t=0.02 * k, u=u, y=y), tuy(Clock(column="t"), Repair(longest_gap=2)))
    assert str(said.value).endswith("are filled; keep the longest piece, 107 of 196 rows, with --range 1.86:3.98")


def test_the_range_that_the_sentence_names_is_read():
    k = np.delete(np.arange(200), np.arange(90, 120))
    u, y = ramp(k)
    made = sample(table(t=7.0 + 0.02 * k, u=u, y=y), tuy(Clock(column="t"), range=parse_range("2.4:3.98")))
    assert made.N == 80
    np.testing.assert_array_equal(made.input[0].values, np.arange(120.0, 200.0))
    assert not made.counts
    later = sample(table(t=7.0 + 0.02 * k, u=u, y=y), tuy(Clock(column="t"), range=parse_range("3:3.5")))
    np.testing.assert_array_equal(later.input[0].values, np.arange(150.0, 176.0))
    assert made.notes == ("used rows 92 to 171, 80 of 170, as the range says",)
    with pytest.raises(InputError, match=r"the range 9: s holds 0 sample\(s\); the record goes from 0 to 3.98 s"):
        sample(table(t=7.0 + 0.02 * k, u=u, y=y), tuy(Clock(column="t"), range=parse_range("9:")))


def test_more_lost_samples_than_allowed_are_refused():
    gone = [3, 9, 20, 26, 40, 44, 46, 48, 60, 63, 77, 80, 83, 99, 101, 130, 133, 138, 150, 160, 164, 171, 180, 185, 190]
    k = np.setdiff1d(np.arange(200), gone)
    u, y = ramp(k)
    told = r"row 5, .*25 of 200 samples are lost, and at most 10% are filled; set longest_gap and most_lost"
    with pytest.raises(InputError, match=told):
        sample(table(t=0.02 * k, u=u, y=y), tuy(Clock(column="t")))
    made = sample(table(t=0.02 * k, u=u, y=y), tuy(Clock(column="t"), Repair(most_lost=0.13)))
    assert made.counts["lost"] == 25


def test_empty_cells_are_refused_or_filled():
    k = np.arange(50.0)
    u, y = ramp(k)
    u[7], y[20:22] = np.nan, np.nan
    with pytest.raises(InputError, match=r"row 9, column 'u': found no value"):
        sample(table(t=k, u=u, y=y), tuy(Clock(column="t")))
    made = sample(table(t=k, u=u, y=y), tuy(Clock(column="t"), Repair(empty="fill")))
    assert made.input[0].values[7] == 6.0
    np.testing.assert_allclose(made.output[0].values, 0.001 * k, atol=1e-15)
    np.testing.assert_array_equal(np.flatnonzero(made.output[0].missing), [20, 21])
    assert made.counts == {"empty cells": 3, "filled samples": 3}
    y[:2], u[47:] = np.nan, np.nan
    made = sample(table(t=k, u=u, y=y), tuy(Clock(column="t"), Repair(empty="fill")))
    assert (made.N, made.sampling.start) == (45, 2.0)
    assert made.counts == {"ends": 5, "empty cells": 3, "filled samples": 3}
    y[30:36] = np.nan
    with pytest.raises(InputError, match=r"row 32, column 'y': found no value in 6 samples in a row"):
        sample(table(t=k, u=u, y=y), tuy(Clock(column="t"), Repair(empty="fill")))
    words = [str(each) for each in k]
    words[3] = "garbled"
    with pytest.raises(InputError, match=r"row 5, column 'u': found 'garbled', which is not a number"):
        sample(table(t=k, u=words, y=k), tuy(Clock(column="t"), Repair(empty="fill")))


@pytest.mark.parametrize("Ts", [1 / 300, 0.0047, 1 / 130])
def test_stamps_rounded_to_a_millisecond_keep_their_samples(Ts):
    """A counter of milliseconds below a step that is no whole number of them, with two samples lost."""
    k = np.delete(np.arange(2000), [500, 1200])
    u, y = ramp(k)
    stamps = np.floor(1e3 * Ts * k + 0.3)
    made = sample(table(t=stamps, u=u, y=y), tuy(Clock(column="t", unit="ms")))
    assert made.Ts == pytest.approx(Ts, rel=1e-3 / Ts / 1998)  # the last stamp is a millisecond off at most
    assert not made.sampling.interpolated
    np.testing.assert_array_equal(np.flatnonzero(made.missing), [500, 1200])
    np.testing.assert_allclose(made.output[0].values, 0.001 * np.arange(2000), atol=1e-12)


def test_jitter_within_the_tolerance_is_taken_as_uniform_and_more_is_interpolated():
    rng, Ts, N = RNG(5), 0.01, 800
    k = np.arange(N)
    for size, uniform in ((0.002, True), (0.2, False)):
        t = Ts * (k + size * rng.uniform(-1, 1, N))
        y = np.sin(4.0 * t)
        u = np.floor(t / 0.1)
        made = sample(table(t=t - t[0], u=u, y=y), tuy(Clock(column="t")))
        assert made.sampling.interpolated is not uniform
        assert made.Ts == pytest.approx(Ts, rel=1e-4)
        if uniform:
            np.testing.assert_array_equal(made.output[0].values, y)
            continue
        at = made.t + t[0]
        # Linear interpolation errs by at most h^2 max|y''| / 8, with steps h of up to 1.4 Ts.
        assert np.abs(made.output[0].values - np.sin(4.0 * at)).max() <= (1.4 * Ts) ** 2 * 16.0 / 8.0
        # Where the held input rises from row to row, its mean over a step lies between the values around the step.
        mean, row = made.input[0].values, np.searchsorted(t, at + 1e-9, side="right") - 1
        last = np.minimum(np.searchsorted(t, at + made.Ts), N - 1)
        assert np.all((u[row] - 1e-9 <= mean) & (mean <= u[last] + 1e-9))


def test_of_irregular_stamps_lost_samples_are_marked_where_they_are_far():
    """Between 0.50 and 0.54 s no row: the line is far from both in the middle alone, the held input from 0.51 on."""
    rng, k = RNG(2), np.setdiff1d(np.arange(120), [51, 52, 53])
    t = 0.01 * k + 0.001 * rng.uniform(-1, 1, len(k)) * (np.abs(k - 52) > 2) * (k > 0)
    made = sample(table(t=t, u=np.floor(t), y=t), tuy(Clock(column="t")))
    assert made.sampling.interpolated
    np.testing.assert_array_equal(np.flatnonzero(made.output[0].missing), [51, 52, 53])
    np.testing.assert_array_equal(np.flatnonzero(made.input[0].missing), [51, 52, 53])
    shifted = np.where(k == 54, 0.535, t)  # sample 53 is now near the row behind it
    made = sample(table(t=shifted, u=np.floor(t), y=t), tuy(Clock(column="t")))
    np.testing.assert_array_equal(np.flatnonzero(made.output[0].missing), [51, 52])
    np.testing.assert_array_equal(np.flatnonzero(made.input[0].missing), [51, 52, 53])


def test_irregular_stamps_are_resampled_at_their_middle_step_or_at_a_given_one():
    rng = RNG(8)
    steps = np.concatenate([rng.uniform(4e-3, 6e-3, 700), rng.uniform(3.2e-3, 3.8e-3, 500)])
    t = np.concatenate([[0.0], np.cumsum(steps)])
    y = np.sin(3.0 * t)
    columns = table(t=t, u=np.sign(y), y=y)
    made = sample(columns, tuy(Clock(column="t")))
    assert made.Ts == float(f"{np.median(steps):.3g}")
    assert np.abs(made.output[0].values - np.sin(3.0 * made.t)).max() <= 6e-3**2 * 9.0 / 8.0
    assert made.counts == {"interpolated": made.N}
    coarse = sample(columns, tuy(Clock(column="t", Ts=0.02)))
    assert coarse.Ts == 0.02
    inner = slice(20, -20)  # the filter's ends
    assert np.abs(coarse.output[0].values - np.sin(3.0 * coarse.t))[inner].max() < 2e-3


def test_a_longer_sampling_time_does_not_alias():
    """A tone above half of the new rate disappears; without a filter it would come back at full size as another one."""
    t = 0.001 * np.arange(4000)
    slow, fast = np.sin(2 * np.pi * 2.0 * t), np.sin(2 * np.pi * 90.0 * t)
    made = sample(table(t=t, u=np.floor(t / 0.5), y=slow + fast), tuy(Clock(column="t", Ts=0.01)))
    assert (made.Ts, made.N) == (0.01, 400)
    left = made.output[0].values - np.sin(2 * np.pi * 2.0 * made.t)
    assert np.abs(left[20:-20]).max() < 0.02
    np.testing.assert_allclose(made.input[0].values, np.floor(made.t / 0.5 + 1e-9), atol=1e-9)


def test_adc_counts_become_the_angle_to_half_a_code():
    angle = np.linspace(-2.3, 2.3, 777)
    codes = np.rint((angle + 2.356) / 4.712 * 1023)
    mapping = tuy(Clock(Ts=0.01)).model_copy(
        update={"output": (Channel(column="y", unit="rad", adc=Adc(counts=(0, 1023), value=(-2.356, 2.356))),)}
    )
    made = sample(table(u=angle, y=codes), mapping)
    assert np.abs(made.output[0].values - angle).max() <= 0.5 * 4.712 / 1023 + 1e-12
    bits = Channel(column="y", unit="deg", adc=Adc(bits=10, value=(-135.0, 135.0)), sign=-1)
    turned = sample(table(u=angle, y=codes), mapping.model_copy(update={"output": (bits,)}))
    np.testing.assert_allclose(turned.output[0].values, -np.deg2rad(codes / 1023 * 270 - 135), atol=1e-12)
    with pytest.raises(InputError, match=r"row 4, column 'y': found 1024 where the adc of the mapping has 0 to 1023"):
        sample(table(u=[1, 2, 3], y=[0, 1, 1024]), mapping.model_copy(update={"output": (bits,)}))


def test_counts_of_a_signed_word_times_a_measured_supply_become_volts():
    duty = np.array([0, 10, -20, 32767, -32768, 3])
    supply = np.array([7.0, 7.1, 7.2, 7.3, 7.4, 7.5])
    channel = Channel(column="load", signed=16, times="volts", scale=1 / 885, offset=0.25, unit="V")
    mapping = ChannelMap(clock=Clock(Ts=0.1), input=(channel,), output=(Channel(column="y", unit="rad"),))
    made = sample(table(load=np.mod(duty, 2**16), volts=supply, y=np.arange(6)), mapping)
    np.testing.assert_allclose(made.input[0].values, duty * supply / 885 + 0.25, atol=1e-12)


def test_the_record_lasts_while_the_torque_is_on():
    on = np.array([0, 0, 1, 1, 1, 1, 0, 1, 1])
    mapping = tuy(Clock(Ts=0.1), range=Range(active="on"))
    made = sample(table(u=np.arange(9), y=np.arange(9), on=on), mapping)
    np.testing.assert_array_equal(made.input[0].values, [2, 3, 4, 5])


def test_a_named_column_that_is_missing_brings_the_closest_names():
    mapping, k = tuy(Clock(column="time")), np.arange(50)
    with pytest.raises(
        InputError, match=r"unknown column 'time' \(clock.column of the mapping\); the closest is 'tim'"
    ):
        sample(table(tim=k, u=k, y=k), mapping)


def test_counts_of_one_kind_add_up_and_kinds_that_were_not_met_are_left_out():
    corrections = [Correction({"lost": 2, "ends": 0}, ""), Correction({"wraps": 1}, ""), Correction({"lost": 3}, "")]
    assert list(total(corrections).items()) == [("wraps", 1), ("lost", 5)]
