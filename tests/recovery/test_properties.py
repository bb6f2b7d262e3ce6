"""What may be done to a record without another fit: signs, clock, digits, order and division, for each structure.

The distance of two fits is the rms of the difference of their runs, over the rms of the errors. A search ends where it
expects to lower the loss by less than 0.01 %: such ends lie within SEARCHED of each other, and from other starts, in
directions in which the loss is flat, within STARTED, which is 1 % of the loss. A record in two parts has two more
states to be estimated, so the fit may move within what noise of N samples leaves open of d parameters, sqrt(d/N) (rms).
"""

import re
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from properties import CASES, fitted, halves, rounded, run_of, turned

import sysid
from sysid.nlarx.result import NlarxFit
from sysid.workflow.record import read_record
from twin.cli import main

EXACT = 1e-6  # of the output's spread: the same steps but for rounding
SEARCHED, STARTED, SAMPLED = 1e-2, 1e-1, 4.0
ONE_WAY = ("servo_joint", "motor_profile", "actuated_joint without stops")  # no map behind the motor takes up a sign
# An absolute value has no sign to turn; the start of a joint on the other side is another start.
SEARCHED_SIGNS = {("coupled_drives", "u"), ("actuated_joint", "u"), ("actuated_joint", "uy")} | {
    (name, "uy") for name in ONE_WAY
}
SIGNS = [
    (name, of)
    for name in CASES
    for of in ("u", "y", "uy")
    if not (name in ONE_WAY and of != "uy") and not (name == "coupled_drives" and "y" in of)
]
QUICK = ("coupled_drives", "hammerstein_wiener", "motor_profile", "nlarx", "output_error", "wiener_hammerstein")
QUICK += ("actuated_joint", "actuated_joint without stops")  # less than 0.1 s a fit


def often(cases):
    """The cases, those of slow structures at night."""
    return [case if case[0] in QUICK else pytest.param(*case, marks=pytest.mark.nightly) for case in cases]


@pytest.fixture(scope="module")
def plain():
    """By name and seed: a record, its fit and the run."""
    made = {}

    def get(name, seed=0, starts=1):
        if (name, seed, starts) not in made:
            data = CASES[name][1](seed)
            fit = fitted(name, data, starts)
            made[name, seed, starts] = data, fit, run_of(fit, data)
        return made[name, seed, starts]

    return get


def distance(data, fit, a, b):
    """The rms of a - b over that of the errors of `a` (N,)."""
    n = fit.n_init
    return float(np.sqrt(np.mean((a - b)[n:] ** 2) / np.mean((data.y[n:, 0] - a[n:]) ** 2)))


def check_sign(name, of, plain, seed=0, starts=1):
    data, fit, run = plain(name, seed, starts)
    other = turned(data, of)
    back = run_of(fitted(name, other, starts), other) * (-1.0 if "y" in of else 1.0)
    if (name, of) in SEARCHED_SIGNS:
        assert distance(data, fit, run, back) < SEARCHED
    else:
        np.testing.assert_allclose(back, run, rtol=0, atol=EXACT * np.std(data.y))


def check_clock(name, ppm, plain, seed=0, starts=1):
    """Nothing but the seconds changes: the run is the same, and poles and rates are those of the other clock."""
    data, fit, run = plain(name, seed, starts)
    other = fitted(name, replace(data, Ts=data.Ts * (1 + 1e-6 * ppm)), starts)
    np.testing.assert_allclose(run_of(other, replace(data, Ts=other.Ts)), run, rtol=0, atol=EXACT * np.std(data.y))
    if not isinstance(fit, NlarxFit) and len(fit.poles):
        s, s_other = (np.log(f.poles.astype(complex)) / f.Ts for f in (fit, other))
        np.testing.assert_allclose(s_other * (1 + 1e-6 * ppm), s, rtol=1e-6)
    assert fit.fit_percent(replace(data, Ts=other.Ts)) == fit.fit_percent(
        data
    )  # one rate: the clock of a model is kept


def check_digits(name, plain, seed=0, starts=1):
    """Six digits round by less than a hundredth of the noise."""
    data, fit, run = plain(name, seed, starts)
    other = rounded(data, 6)
    assert distance(data, fit, run, run_of(fitted(name, other, starts), other)) < SEARCHED


def check_order_and_split(name, plain, seed=0, starts=1):
    data, fit, run = plain(name, seed, starts)
    a, b = halves(data)
    first, second = (fitted(name, sysid.IOData.merge(*parts), starts) for parts in ((a, b), (b, a)))
    assert distance(data, fit, run_of(first, data), run_of(second, data)) < STARTED
    assert distance(data, fit, run, run_of(first, data)) < SAMPLED * np.sqrt(fit.criteria.d / data.N)


@pytest.mark.parametrize(("name", "of"), often(SIGNS))
def test_a_turned_signal_turns_the_fit(name, of, plain):
    check_sign(name, of, plain)


@pytest.mark.parametrize(("name", "ppm"), often([(name, ppm) for name in CASES for ppm in (100, -100)]))
def test_a_clock_that_is_off_by_100_ppm_is_another_unit_of_time(name, ppm, plain):
    check_clock(name, ppm, plain)


@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.nightly) for n in CASES])
def test_the_last_digit_of_a_text_moves_no_fit(name, plain):
    check_digits(name, plain)


# One start of a network may end elsewhere; the test of the night has the usual five.
@pytest.mark.parametrize(
    "name",
    [n if n in QUICK else pytest.param(n, marks=pytest.mark.nightly) for n in CASES if n != "nlarx"],
)
def test_two_files_in_any_order_are_the_record(name, plain):
    check_order_and_split(name, plain)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", CASES)
def test_all_of_it_with_the_usual_starts(name, seed, plain):
    for case, of in SIGNS:
        if case == name:
            check_sign(name, of, plain, seed, 5)
    for ppm in (-100, -3, 100):
        check_clock(name, ppm, plain, seed, 5)
    check_digits(name, plain, seed, 5)
    check_order_and_split(name, plain, seed, 5)


@pytest.mark.parametrize("of", ["u", "y"])
@pytest.mark.parametrize("name", ONE_WAY)
def test_a_motor_that_cannot_turn_says_which_way_the_record_goes(name, of, plain):
    """And turned back as the sentence says, the record has the fit of the other one."""
    data, fit, run = plain(name)
    assert not any("turned" in warning for warning in fit.warnings)
    other = turned(data, of)
    bad = fitted(name, other)
    assert "one of the two signals is turned; turn it back with sign = -1" in bad.warnings[0]
    assert "replace(data, y=-data.y)" in bad.warnings[0]
    back = fitted(name, replace(other, y=-other.y))
    gain = -1.0 if of == "u" else 1.0
    assert distance(data, fit, run, gain * run_of(back, replace(other, y=-other.y))) < SEARCHED


def test_a_map_behind_a_motor_takes_the_sign_up_and_nothing_is_said(plain):
    data, _, _ = plain("actuated_joint")
    assert not any("turned" in warning for warning in fitted("actuated_joint", turned(data, "y")).warnings)


def test_the_sign_of_the_map_turns_the_channel_back(plain, tmp_path, capsys):
    data = turned(plain("motor_profile")[0], "y")
    log, table = tmp_path / "log.csv", tmp_path / "map.toml"
    pl.DataFrame({"time_s": data.t, "volts_V": data.u[:, 0], "angle_rad": data.y[:, 0]}).write_csv(log)
    words = ["--time", "time_s", "--input", "volts_V", "--output", "angle_rad"]
    small = ["--structure", "motor_profile", "--orders", "3", "--starts", "1", "--out", str(tmp_path / "fit")]
    assert main(["identify", str(log), *words, *small]) in (0, 1)
    said = " ".join(capsys.readouterr().out.split())
    assert "one of the two signals is turned" in said
    assert re.search(r"qpal info \S*log.csv .*--write-map MAP.toml", said)
    assert main(["info", str(log), *words, "--write-map", str(table)]) == 0
    head, output = table.read_text().split("[[output]]")
    table.write_text(f"{head}[[output]]{output.replace('sign = 1 ', 'sign = -1 ', 1)}")
    assert main(["identify", str(log), "--map", str(table), *small]) == 0
    assert "signals is turned" not in capsys.readouterr().out


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_order_of_columns_is_no_part_of_a_record(suffix, tmp_path):
    data = CASES["output_error"][1](0)
    table = pl.DataFrame({"time_s": data.t, "volts_V": data.u[:, 0], "angle_rad": data.y[:, 0], "load_N": data.t**2})
    read = []
    for k, order in enumerate(([0, 1, 2, 3], [3, 2, 1, 0], [2, 0, 3, 1])):
        file = tmp_path / f"{k}{suffix}"
        part = table.select([table.columns[j] for j in order])
        part.write_csv(file) if suffix == ".csv" else part.write_parquet(file)
        read.append(read_record(str(file), "volts_V", "angle_rad", None, "time_s").data)
    for other in read[1:]:
        np.testing.assert_array_equal(other.u, read[0].u)
        np.testing.assert_array_equal(other.y, read[0].y)
        assert (other.Ts, other.u_name, other.y_name) == (read[0].Ts, read[0].u_name, read[0].y_name)
