"""Scenarios of the benchmark: the same task twice, bit for bit; truth and noise make the record; official splits."""

import json
import pickle

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from sysid.base.errors import InputError
from sysid.bench.scenarios import TABLE
from sysid.bench.scenarios.real import RECORDS, Real
from sysid.bench.scenarios.stress import Stress


def same(a, b):
    """Whether two records are equal to the last bit."""
    masks = [np.zeros_like(r.y, dtype=bool) if r.missing is None else r.missing for r in (a, b)]
    equal = np.array_equal(a.u, b.u) and np.array_equal(a.y, b.y) and np.array_equal(*masks)
    return equal and (a.Ts, a.lengths) == (b.Ts, b.lengths)


def made_twice(family, scenario, seed):
    """The task, once it is the same when another process makes it."""
    task, again = family.make(scenario, seed), pickle.loads(pickle.dumps(family)).make(scenario, seed)
    assert same(task.train, again.train)
    assert list(task.tests) == list(again.tests)
    assert all(same(task.tests[name], again.tests[name]) for name in task.tests)
    assert (task.drop, task.unit, task.orders, task.given) == (again.drop, again.unit, again.orders, again.given)
    return task


SYNTHETIC = [(name, scenario) for name in sorted(TABLE) if name != "real" for scenario in TABLE[name].scenarios()]


@pytest.mark.parametrize(("family", "scenario"), SYNTHETIC)
def test_a_task_is_the_same_twice_and_another_seed_gives_another_record(family, scenario):
    task, other = made_twice(TABLE[family], scenario, 5), TABLE[family].make(scenario, 6)
    assert not same(task.train, other.train)
    assert all(not same(task.train, test) for test in task.tests.values())


# From the protocols of each benchmark: samples of the training experiments and of each test, dropped samples, unit.
PROTOCOLS = {
    "ced": ([400, 400], [100, 100], 10, "ticks/s", 0.02),
    "emps": ([24841], [24841], 20, "mm", 0.001),
    "cascaded_tanks": ([1024], [1024], 50, "V", 4.0),
    "silverbox": ([65062], [21688, 40475, 32000], 50, "mV", 1 / 610.35),
    "hair_dryer": ([500], [500], 50, "V", 0.08),
    "robot_arm": ([512], [512], 50, "", 1.0),
}


@pytest.mark.parametrize("scenario", sorted(RECORDS))
def test_a_record_is_the_same_twice(records, scenario):
    made_twice(Real(folder=str(records)), scenario, 3)


@pytest.mark.parametrize("scenario", sorted(PROTOCOLS))
def test_splits_drops_units_and_rates_are_the_official_ones(records, scenario):
    task = Real(folder=str(records)).make(scenario, 0)
    train, tests, drop, unit, Ts = PROTOCOLS[scenario]
    assert list(task.train.lengths) == train
    assert [test.N for test in task.tests.values()] == tests
    assert (task.drop, task.unit) == (drop, unit)
    assert task.train.Ts == pytest.approx(Ts)


def test_the_servos_held_out_gain_is_in_no_estimation_record(records):
    """16 logs of four gains: twelve to fit, the four of gain 400 to run, under the names of their trajectories."""
    task = Real(folder=str(records)).make("bam_xl330", 0)
    logs = [json.loads(path.read_text()) for path in (records / "bam_xl330").glob("*.json")]
    assert sorted(task.tests) == sorted(log["trajectory"] for log in logs if log["kp"] == 400)
    first = {log["entries"][0]["position"] for log in logs if log["kp"] != 400}
    assert (len(logs), len(task.train.lengths), len(task.tests)) == (16, 12, 4)
    assert {float(e.y[0, 0]) for e in task.train.experiments} == first


def test_the_first_numbers_of_each_split_are_those_of_the_files(records):
    """Read from the files by hand, in the unit of the protocol."""
    real = Real(folder=str(records))
    ced, emps, box = (real.make(name, 0) for name in ("ced", "emps", "silverbox"))
    np.testing.assert_allclose(ced.train.experiments[1].u[0], [2.1961])
    np.testing.assert_allclose(ced.train.experiments[0].y[0], [-0.021978])
    lines = (records / "silverbox" / "SNLS80mV.csv").read_text().splitlines()[1:]
    for record, at in ((box.train, 40650), (box.tests["multisine"], 105712), (box.tests["arrow"], 100)):
        u, y = (1e3 * float(cell) for cell in lines[at].split(",")[:2])
        np.testing.assert_allclose([record.u[0, 0], record.y[0, 0]], [u, y])
    assert 240.0 < float(np.ptp(emps.train.y)) < 260.0  # the carriage travels a quarter of a metre


def test_a_record_that_is_not_there_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.delenv("QPAL_RECORDS", raising=False)
    for name in RECORDS:
        with pytest.raises(InputError, match=r"download it from https://.* set QPAL_RECORDS"):
            Real().make(name, 0)
        with pytest.raises(InputError, match=rf"the record {name} is not there: no file {tmp_path}.*; download it"):
            Real(folder=str(tmp_path)).make(name, 0)
    with pytest.raises(InputError, match="record 'emsp'"):
        Real().make("emsp", 0)


def test_the_folder_comes_from_the_environment(records, monkeypatch):
    monkeypatch.setenv("QPAL_RECORDS", str(records))
    assert Real().make("hair_dryer", 0).train.N == 500


def test_the_published_linear_row_of_the_silverbox_is_found_again(records):
    """An output error of two poles by scipy alone gives 6.96 / 14.4 / 6.58 mV, to the digits that are published."""
    task = Real(folder=str(records)).make("silverbox", 0)
    u0, y0 = task.train.u.mean(), task.train.y.mean()
    u, y = task.train.u[:, 0] - u0, task.train.y[:, 0] - y0
    arx = np.column_stack([u[2:], u[1:-1], u[:-2], -y[1:-1], -y[:-2]])
    start = np.linalg.lstsq(arx, y[2:], rcond=None)[0]
    found = least_squares(lambda p: lfilter(p[:3], [1.0, *p[3:]], u) - y, start, x_scale=np.abs(start)).x
    errors = []
    for test in task.tests.values():
        v, z = test.u[:, 0] - u0, test.y[:, 0] - y0
        run = lfilter(found[:3], [1.0, *found[3:]], v)
        own = np.column_stack([lfilter([1.0], [1.0, *found[3:]], np.eye(1, len(v), k)[0]) for k in (0, 1)])
        state = np.linalg.lstsq(own[: task.drop], (z - run)[: task.drop], rcond=None)[0]
        errors.append(np.sqrt(np.mean((z - run - own @ state)[task.drop :] ** 2)))
    np.testing.assert_array_less(np.abs(np.array(errors) - [6.96, 14.4, 6.58]), [0.005, 0.05, 0.005])


def clean(truth, u):
    """The output of a stress plant by scipy alone: saturation, B/F with a delay of one sample, saturation."""
    p = dict(zip(truth.chain.names, truth.theta, strict=True))
    x = np.clip(u, p["input.lower"], p["input.upper"]) if "input.lower" in p else u
    w = lfilter([0.0, p["linear.b0"], p["linear.b1"]], [1.0, p["linear.f1"], p["linear.f2"]], x)
    return np.clip(w, p["output.lower"], p["output.upper"]) if "output.lower" in p else w


@pytest.mark.parametrize("scenario", Stress().scenarios())
def test_truth_and_white_noise_make_the_test_of_a_spoilt_record(scenario):
    """For plants with and without a saturation; 2 % of noise, within four standard deviations of its estimate."""
    kinds = set()
    for seed in range(8):
        task = Stress().make(scenario, seed)
        truth, test = task.truth, task.tests["test"]
        own = clean(truth, test.u[:, 0])
        np.testing.assert_allclose(truth.y["test"], own, rtol=0, atol=1e-9 * own.std())
        share = (test.y[:, 0] - own).std() / own.std()
        assert share == pytest.approx(0.02, rel=4.0 / np.sqrt(2.0 * test.N))
        f = [1.0, *(truth.theta[truth.chain.names.index(f"linear.{name}")] for name in ("f1", "f2"))]
        np.testing.assert_allclose(np.polyval(f, truth.poles), 0.0, atol=1e-12)
        kinds.add(len(truth.chain.names))
    assert len(kinds) > 1


def left(scenario, seed):
    """The task, and its output less the clean one over the standard deviation of the noise."""
    task = Stress().make(scenario, seed)
    return task, (task.train.y[:, 0] - clean(task.truth, task.train.u[:, 0])) / task.truth.noise


@pytest.mark.parametrize("scenario", ["constant", "feedback", "missing", "poor", "units"])
def test_white_noise_alone_is_on_the_records_whose_output_is_not_spoilt(scenario):
    task, e = left(scenario, 1)
    e = e[task.train.observed[:, 0]]
    assert e.std() == pytest.approx(1.0, rel=4.0 / np.sqrt(2.0 * len(e)))
    assert np.abs(e).max() < 5.0


def test_every_record_is_spoilt_as_its_scenario_says():
    assert Stress().make("short", 0).train.N == 60
    _, hit = left("outliers", 0)
    assert 5 <= (np.abs(hit) > 100.0).sum() <= 40  # 3 standard deviations of y are 150 of its noise
    gone = Stress().make("missing", 0).train.missing
    assert 0.16 < gone.mean() < 0.19
    _, off = left("drift", 0)
    assert np.abs(np.diff(off)).max() < 10.0
    assert np.ptp(off) > 15.0  # half a standard deviation of y are 25 of its noise
    assert len(np.unique(np.round(Stress().make("quantised", 0).train.y, 9))) <= 14
    u = Stress().make("constant", 0).train.u[:, 0]
    assert np.mean(np.diff(u) == 0.0) > 0.75
    spectrum = np.abs(np.fft.rfft(Stress().make("poor", 0).train.u[:, 0] * np.hanning(1000)))
    assert np.sum(spectrum > 0.05 * spectrum.max()) <= 5


def test_the_input_in_closed_loop_holds_the_noise():
    """u + K y with the noisy y is a sequence of held levels that knows nothing of the noise, and u alone is not."""
    for seed in range(4):
        task, e = left("feedback", seed)
        u, y = task.train.u[:, 0], task.train.y[:, 0]
        K = float(task.given.split("gain ")[1].split(",")[0])
        reference = u + K * y  # K is told with two digits
        assert np.median(np.abs(np.diff(reference))) < 0.02
        assert abs(np.corrcoef(reference, e)[0, 1]) < 4.0 / np.sqrt(len(e))
        assert np.median(np.abs(np.diff(u))) > 2.0 * np.median(np.abs(np.diff(reference)))


def test_units_go_from_1e_9_to_1e9():
    sizes = np.log10([[t.train.u.std(), t.train.y.std()] for t in (Stress().make("units", k) for k in range(30))])
    assert np.all(np.abs(sizes) < 10.0)
    assert np.all(sizes.min(axis=0) < -5.0)
    assert np.all(sizes.max(axis=0) > 5.0)
