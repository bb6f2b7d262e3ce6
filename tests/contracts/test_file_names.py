"""A name of a file or folder is a name: [, ] and * in it choose no other files."""

import sys

import numpy as np
import pytest

import twin
from sysid.formats import WRITTEN, read_table

NAMES = ["log[1]", "log[!a]", *([] if sys.platform == "win32" else ["log*", "log?", "*"])]
OTHERS = ["log1", "logb", "log"]  # what those would choose as patterns


def log(level: float) -> twin.Log:
    return twin.Log(np.full(20, level), np.arange(20) * level, 0.1, np.arange(20) * level, "thigh", {"level": level})


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize("name", NAMES)
def test_a_log_is_read_from_the_file_of_its_name(name, suffix, tmp_path):
    for k, other in enumerate(OTHERS, start=2):
        log(float(k)).save(tmp_path / f"{other}{suffix}")
    log(1.0).save(tmp_path / f"{name}{suffix}")
    again = twin.Log.load(tmp_path / f"{name}{suffix}")
    assert np.array_equal(again.u, np.ones(20))
    assert np.array_equal(again.y, np.arange(20))
    assert again.meta.get("level", 1.0) == 1.0
    for k, other in enumerate(OTHERS, start=2):  # and written to no other
        assert twin.Log.load(tmp_path / f"{other}{suffix}").u[0] == k


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize("name", NAMES)
def test_every_reader_takes_the_folder_by_its_name(name, suffix, tmp_path):
    for level, folder in enumerate([name, *OTHERS], start=1):
        (tmp_path / folder).mkdir()
        log(float(level)).save(tmp_path / folder / f"a{suffix}")
    assert np.array_equal(read_table(tmp_path / name / f"a{suffix}").numbers("voltage_V"), np.ones(20))


@pytest.mark.parametrize("name", NAMES)
def test_an_ensemble_reads_its_own_folder(name, tmp_path):
    experiment = twin.Experiment("thigh", "aprbs", 1.0)
    for other in OTHERS:
        twin.Ensemble(experiment, [7], None, tmp_path / other).run()
    whole = twin.Ensemble(experiment, [3, 4], None, tmp_path / name, part=1).run()
    assert whole.table()["seed"].to_list() == [3, 4]
    for number, found in enumerate(whole):
        assert np.array_equal(found.y, whole.case(number).run().y)
    assert len(list(tmp_path.iterdir())) == len(OTHERS) + 1
