"""What of a run is left where its host is killed, or its disk is full."""

import json

import numpy as np
import pytest

import twin
from sysid.base.errors import InputError
from twin.rig import journal as journals
from twin.rig.journal import journal, recover
from twin.rig.run import Input, check_input, log_of, play

TS = 0.02


class Full:
    """A disk that is full after some bytes, of which the last write takes only a part."""

    def __init__(self, file, size):
        self._file, self._left = file, size

    def write(self, data):
        if not self._left:
            raise OSError(28, "No space left on device")
        part = data[: self._left]
        self._left -= len(part)
        return self._file.write(part)

    def __getattr__(self, name):
        return getattr(self._file, name)


def journalled(rig, folder, u, **settings):
    """The log of a run with its journal, and the lines of the journal at its end."""
    with rig(**settings) as (_, link, calibration):
        levels = check_input(Input(u, TS), calibration)
        with journal(folder / "o.csv", link, calibration, levels, TS, "drawn steps") as link.watch:
            recording = play(link, calibration.setup(link.identity.full), levels, TS)
            lines = (folder / "o.csv.journal").read_bytes()
        return log_of(recording, calibration, link, "drawn steps"), lines


def test_a_journal_cut_anywhere_gives_the_log_up_to_there(rig, steps, tmp_path):
    """A kill may leave half a line; lost samples are lost in both."""
    log, content = journalled(rig, tmp_path, steps(), garbled=0.02)
    assert list(tmp_path.iterdir()) == []  # it has gone with its run
    assert np.isnan(log.y).any()
    rows = content.count(b"\n") - 1
    assert rows == np.count_nonzero(~np.isnan(log.y))
    for size in (len(content), len(content) - 3, len(content) // 2 + content[len(content) // 2 :].index(b"\n") + 1):
        (tmp_path / "o.csv.journal").write_bytes(content[:size])
        (path,) = recover(tmp_path)
        assert [p.name for p in tmp_path.iterdir()] == ["o.csv"]
        found = twin.Log.load(path)
        path.unlink()
        last = content[:size].rpartition(b"\n")[0].rpartition(b"\n")[2]
        assert int(last.split(b",")[0]) + 1 == found.N
        assert found.u == pytest.approx(log.u[: found.N], abs=1e-12)
        came = ~np.isnan(log.y[: found.N])
        assert found.y[came] == pytest.approx(log.y[: found.N][came], abs=1e-12)
        assert (found.Ts, found.joint, found.meta["excitation"]) == (log.Ts, log.joint, "drawn steps")
        assert found.meta["filled"] == [k for k in log.meta["filled"] if k < found.N]
        assert "its host was killed" in found.meta["rig"]["ended_early"]


def test_a_journal_that_is_none_is_left_and_told(tmp_path):
    path = tmp_path / "o.csv.journal"
    for text, said in (("no json\n1,2\n", "is no journal of a run"), ('{"levels": []}\n1,2\n', "is no journal")):
        path.write_text(text)
        with pytest.raises(InputError, match=said):
            recover(tmp_path)
        assert path.read_text() == text
    path.write_text('{"firmware": "rig 1.0.0", "calibr')  # killed before its first sample
    assert recover(tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_still_plays_and_a_log_that_is_there_are_left_alone(rig, steps, tmp_path):
    with rig() as (_, link, calibration):
        levels = check_input(Input(steps(100), TS), calibration)
        with journal(tmp_path / "o.csv", link, calibration, levels, TS) as link.watch:
            play(link, calibration.setup(link.identity.full), levels, TS)
            before = sorted(tmp_path.iterdir())
            assert recover(tmp_path) == []
            assert sorted(tmp_path.iterdir()) == before
            content = (tmp_path / "o.csv.journal").read_bytes()
    (tmp_path / "o.csv.journal").write_bytes(content)
    (tmp_path / "o.csv").write_text("another log")
    with pytest.raises(InputError, match="is there already; move one"):
        recover(tmp_path)
    assert (tmp_path / "o.csv").read_text() == "another log"
    assert json.loads(content.split(b"\n")[0])["Ts"] == TS


def test_a_full_disk_ends_the_run_and_what_came_is_kept(rig, steps, tmp_path, monkeypatch):
    real = journals._Writer
    monkeypatch.setattr(journals, "_Writer", lambda file, head: real(Full(file, 4000), head))
    log, content = journalled(rig, tmp_path, steps())
    assert "its samples could no longer be written" in log.meta["rig"]["ended_early"]
    assert len(content) == 4000
    assert 50 < content.count(b"\n") - 1 <= log.N < 400
    assert not np.isnan(log.y).any()
