"""Channels that an oscilloscope exported into a file each: together they are one record."""

import numpy as np
import pytest
from plants_in_time import GAIN, TAU, level_at, pole_and_gain, response, steps

import sysid
from sysid.base.errors import InputError
from sysid.channels.one_record import as_one
from sysid.formats import read_table
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting

TS = 0.02
T = np.arange(600) * TS
U, Y = (of(T, *steps(3, 0.24, 12.0)) for of in (level_at, response))
SETTING = Setting(sysid.structures.OutputError(1, 1, 1), starts=1)
TEKTRONIX = ["Model,MDO3024", "Firmware Version,1.26", "", "Waveform Type,ANALOG,", "Horizontal Units,s,"]
TEKTRONIX += [f"Sample Interval,{TS},", "Record Length,600,", "Vertical Units,V,", ",,"]


def tektronix(k, x):
    return [*TEKTRONIX, f"TIME,CH{k}", *(f"{t - 2.4:.6e},{value:.12e}" for t, value in zip(T, x, strict=True))]


def rigol(k, x):
    rows = (f"{i},{value:.12e},," for i, value in enumerate(x))
    return [f"X,CH{k},Start,Increment,", f"Sequence,Volt,-2.4,{TS:.6e}", *rows]


def plain(k, x, t=T):
    return ["t,value", *(f"{stamp:.6f},{value:.12e}" for stamp, value in zip(t, x, strict=True))]


def write(folder, form, names=("a.csv", "b.csv")):
    paths = [folder / name for name in names]
    for k, (path, x) in enumerate(zip(paths, (U, Y), strict=True), start=1):
        path.write_text("\n".join(form(k, x)) + "\n")
    return paths


@pytest.mark.parametrize(("form", "u", "y"), [(tektronix, "CH1", "CH2"), (rigol, "CH1", "CH2"), (plain, "a", "b")])
def test_two_files_of_a_channel_each_are_one_record(form, u, y, tmp_path):
    paths = write(tmp_path, form)
    for order in (paths, paths[::-1]):
        result = identify_file(order, SETTING, u, y)
        data = result.record.data
        assert data.lengths == (600,)
        assert pole_and_gain(data.u[:, 0], data.y[:, 0]) == pytest.approx((np.exp(-TS / TAU), GAIN), abs=1e-6)
        assert result.record.paths == tuple(order)
        assert result.record.as_dict()["files"] == [str(path) for path in order]
        note = f"one record with one time: {(u if order is paths else y)!r} of {order[0].name}"
        assert any(note in each for each in result.record.notes)


def test_the_refusal_of_one_of_the_files_names_what_works(tmp_path):
    paths = write(tmp_path, tektronix)
    with pytest.raises(InputError, match="all files where each holds one signal of a record"):
        identify_file(paths[:1], SETTING)
    with pytest.raises(InputError, match="columns 'CH1', 'CH2' may each be the input; name one with --input"):
        identify_file(paths, SETTING)
    assert identify_file(paths, SETTING, "CH1", "CH2").record.data.N == 600


def test_files_of_other_times_are_no_record_and_whole_records_stay_experiments(tmp_path):
    paths = write(tmp_path, plain)
    paths[1].write_text("\n".join(plain(2, Y, T + 0.5 * TS)) + "\n")
    with pytest.raises(InputError, match="no column is left"):
        identify_file(paths, SETTING)
    whole = [tmp_path / "c.csv", tmp_path / "d.csv"]
    for path in whole:
        np.savetxt(path, np.column_stack([T, U, Y]), delimiter=",", header="t,u,y", comments="")
    assert identify_file(whole, SETTING).record.data.lengths == (600, 600)


def test_files_of_other_stamps_are_one_record_with_a_clock_each(tmp_path):
    """The output is read 5 ms later than the input: two coefficients without a delay hold what lies between."""
    late = T[:-1] + 0.005
    y = response(late, *steps(3, 0.24, 12.0))
    for name, t, x in (("volts", T, U), ("speed", late, y)):
        lines = [f"Time,{name}", *(f"{stamp:.6f},{value:.12e}" for stamp, value in zip(t, x, strict=True))]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines) + "\n")
    paths = [tmp_path / "volts.csv", tmp_path / "speed.csv"]
    setting = Setting(sysid.structures.OutputError(2, 1, 0), starts=1)
    for files in (paths, paths[::-1]):
        found = identify_file(files, setting, "volts", "speed")
        assert len(late) == found.record.data.N
        assert any("one record, each with its time" in note for note in found.record.notes)
        assert found.evaluation.poles[0].real == pytest.approx(np.exp(-TS / TAU), abs=1e-6)


@pytest.mark.parametrize(("later", "joined"), [(4.0, True), (8.0, False), (100.0, False)])
def test_files_that_hardly_overlap_are_no_record(later, joined, tmp_path):
    """Of 12 s each."""
    for name, t in (("volts", T), ("speed", T + later)):
        lines = [f"Time,{name}", *(f"{stamp:.6f},{value:.12e}" for stamp, value in zip(t, U, strict=True))]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines) + "\n")
    tables = [read_table(tmp_path / f"{name}.csv") for name in ("volts", "speed")]
    assert (as_one(tables) is not None) == joined
    if not joined:
        with pytest.raises(InputError, match="no column is left for the output"):
            identify_file([tmp_path / "volts.csv", tmp_path / "speed.csv"], SETTING)
