"""Data sets in other people's layouts: the numbers of the files, the official windows, and what is refused."""

import pickle
from dataclasses import dataclass

import h5py
import numpy as np
import pytest

from sysid.base.errors import InputError
from sysid.bench.layouts import Files, Ready, of_objects


@dataclass
class Set:
    """The attributes that sets of `nonlinear_benchmarks` 1.0 have."""

    u: np.ndarray
    y: np.ndarray
    sampling_time: float | None = 0.02
    name: str = ""
    state_initialization_window_length: int | None = None


def write(path, u, y, fs=None, known=None):
    """A file as identibench 0.4 writes it: one float32 data set a channel, rate and known samples as attributes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        for kind, x in (("u", u), ("y", y)):
            for k, column in enumerate(np.asarray(x).reshape(len(x), -1).T):
                file.create_dataset(f"{kind}{k}", data=column, dtype="f4")
        file.attrs.update({"fs": fs} if fs else {})
        file.attrs.update({"init_sz": known} if known else {})


def numbers(n, first):
    return np.arange(first, first + n) * 0.5, np.arange(first, first + n) * -0.25


def test_objects_become_a_task_with_their_window_and_names():
    tests = (Set(*numbers(20, 5), name="slow", state_initialization_window_length=7), Set(*numbers(30, 9)))
    task = of_objects([Set(*numbers(40, 0)), Set(*numbers(50, 3))], tests, "mV", (2, 2, 1), {"linear": "6.96"})
    assert task.train.lengths == (40, 50)
    np.testing.assert_array_equal(task.train.experiments[1].u[:, 0], numbers(50, 3)[0])
    np.testing.assert_array_equal(task.tests["test 2"].y[:, 0], numbers(30, 9)[1])
    assert list(task.tests) == ["slow", "test 2"]
    assert (task.train.Ts, task.drop, task.unit, task.orders) == (0.02, 7, "mV", (2, 2, 1))
    assert task.published == {"linear": "6.96"}


def test_one_object_each_columns_of_one_channel_and_no_rate():
    u, y = numbers(40, 0)
    task = of_objects(Set(u[:, None], y[:, None], None), Set(u, y, None))
    assert (task.train.Ts, task.train.lengths, task.drop) == (1.0, (40,), 50)
    np.testing.assert_array_equal(task.train.u, u[:, None])


def test_tests_of_one_name_are_numbered():
    parts = [Set(*numbers(20, k), name="same") for k in range(2)]
    task = of_objects(Set(*numbers(40, 0)), parts)
    assert list(task.tests) == ["test 1", "test 2"]
    assert [t.u[0, 0] for t in task.tests.values()] == [0.0, 0.5]


def test_several_channels_and_other_rates_are_refused_in_a_sentence(tmp_path):
    u, y = numbers(40, 0)
    wide = np.column_stack([y, y, y])
    with pytest.raises(InputError, match=r"1 input\(s\) .* and 3 output\(s\)"):
        of_objects(Set(u, wide), Set(u, wide))
    with pytest.raises(InputError, match=r"sampled every 0.1 s and the estimation record every 0.02 s"):
        of_objects(Set(u, y), Set(u, y, 0.1))
    write(tmp_path / "train" / "a.hdf5", u, wide, 10.0)
    write(tmp_path / "test" / "b.hdf5", u, wide, 10.0)
    with pytest.raises(InputError, match=r"b.hdf5 has 1 input\(s\) .* and 3 output\(s\)"):
        Files(str(tmp_path)).make(tmp_path.name, 0)


def test_a_folder_of_sets_is_a_family(tmp_path):
    write(tmp_path / "box" / "train" / "train_0.hdf5", *numbers(40, 0), 50.0)
    write(tmp_path / "box" / "valid" / "valid_0.hdf5", *numbers(10, 40), 50.0)
    write(tmp_path / "box" / "test" / "test_0.hdf5", *numbers(20, 4), 50.0, 9)
    write(tmp_path / "box" / "test_ood" / "test_0.hdf5", *numbers(30, 8), 50.0)
    write(tmp_path / "drive" / "train" / "train_0.hdf5", *numbers(40, 0))
    write(tmp_path / "drive" / "train_valid" / "train_valid_0.hdf5", *numbers(60, 0))
    write(tmp_path / "drive" / "test" / "test_0.hdf5", *numbers(20, 4))
    (tmp_path / "notes").mkdir()
    family = pickle.loads(pickle.dumps(Files(str(tmp_path), unit="V")))
    assert list(family.scenarios()) == ["box", "drive"]
    box, drive = family.make("box", 0), family.make("drive", 1)
    assert (box.train.lengths, box.train.Ts, box.drop, box.unit) == ((40, 10), 0.02, 9, "V")
    assert {name: t.N for name, t in box.tests.items()} == {"test_0": 20, "test_ood/test_0": 30}
    np.testing.assert_array_equal(box.train.experiments[1].y[:, 0], numbers(10, 40)[1])
    np.testing.assert_array_equal(box.tests["test_0"].u[:, 0], numbers(20, 4)[0])
    assert (drive.train.lengths, drive.train.Ts, drive.drop) == ((60,), 1.0, 50)
    assert list(Files(str(tmp_path / "box")).scenarios()) == ["box"]


def test_what_is_no_set_says_what_to_do(tmp_path):
    with pytest.raises(InputError, match="holds no data set; give a folder with train"):
        Files(str(tmp_path / "nowhere")).scenarios()
    write(tmp_path / "one" / "test" / "a.hdf5", *numbers(20, 0))
    with pytest.raises(InputError, match=r"no \.hdf5 file in train_valid, train or valid"):
        Files(str(tmp_path)).make("one", 0)
    (tmp_path / "one" / "train").mkdir()
    (tmp_path / "one" / "train" / "a.hdf5").write_text("u0,y0")
    with pytest.raises(InputError, match=r"a.hdf5 is no HDF5 file"):
        Files(str(tmp_path)).make("one", 0)
    with pytest.raises(InputError, match="data set 'two'"):
        Files(str(tmp_path)).make("two", 0)


def test_ready_tasks_are_a_family():
    task = of_objects(Set(*numbers(40, 0)), Set(*numbers(20, 0)))
    family = Ready({"mine": task})
    assert list(family.scenarios()) == ["mine"]
    assert family.make("mine", 4) is task
    with pytest.raises(InputError, match="scenario 'other'"):
        family.make("other", 0)
