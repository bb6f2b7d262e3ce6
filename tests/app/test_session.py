"""A session opens again as it was; what is damaged becomes a sentence, and the rest opens."""

import json
import os
import zipfile

import numpy as np
import pytest
from pydantic import ValidationError

from sysid.base.errors import InputError
from twin.app.desk import display_name, suffix_of
from twin.app.entries import Data, Model, Prepare, Setting
from twin.app.session import Session

MODEL = Model(
    name="output_error (1,1,1)",
    data="d1",
    prepare=Prepare(start=1.0),
    setting=Setting(structure="output_error", settings={"nb": 1, "nf": 1, "nk": 1}),
    fit_estimation=90.0,
    fit_validation=None,
    d=3,
    N=200,
    seconds=1.0,
    converged=True,
)


@pytest.fixture
def session(tmp_path):
    made = Session.open(tmp_path / "s")
    for name in ("one.csv", "two.csv"):
        made.add(Data(name=name, suffix=".csv"), lambda folder: (folder / "log.csv").write_text("u,y\n1,2\n"))
    made.add(MODEL, lambda folder: (folder / "model.json").write_text("{}"))
    made.change(shown="d2")
    yield made
    made.close()


def again(session):
    session.close()
    return Session.open(session.folder)


def test_it_opens_as_it_was(session):
    session.change_data("d1", prepare=Prepare(start=2.0, detrend="mean"), joint="thigh")
    found = again(session)
    assert (found.data, found.models, found.head) == (session.data, session.models, session.head)
    assert found.data["d1"].prepare == Prepare(start=2.0, detrend="mean")
    assert found.complaints == []
    found.close()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "models/m1/entry.json is damaged"),
        ("[]", "models/m1/entry.json is damaged"),
        ('{"name": 3}', "models/m1/entry.json is damaged: name is '3'"),
        (MODEL.model_dump_json().replace('"d":3', '"d":"x"'), "d is 'x'"),
        (MODEL.model_dump_json().replace('"d":3', '"d":3,"more":1'), "more is '1'"),
        (MODEL.model_dump_json().replace('"d1"', '"../../etc"'), "data is '../../etc'"),
        (MODEL.model_dump_json().replace("90.0", "NaN"), "fit_estimation"),
    ],
)
def test_a_damaged_model_is_a_sentence_and_the_rest_opens(session, text, said):
    path = session.folder / "models" / "m1" / "entry.json"
    path.write_text(text)
    found = again(session)
    assert found.models == {}
    assert list(found.data) == ["d1", "d2"]
    assert len(found.complaints) == 1
    assert said in found.complaints[0]
    assert path.read_text() == text  # nothing is lost
    assert found.add(MODEL, lambda folder: None) == "m2"  # and nothing written over
    found.close()


def test_a_log_that_is_gone_and_damaged_settings_are_sentences(session):
    (session.folder / "data" / "d1" / "log.csv").unlink()
    (session.folder / "session.json").write_text('{"format": "qpal session", "version": 1, "shown": 7}')
    found = again(session)
    assert list(found.data) == ["d2"]
    assert ["d1 is left out" in text for text in found.complaints] == [False, True]
    assert "session.damaged.json" in found.complaints[0]
    assert (found.folder / "session.damaged.json").is_file()
    found.close()


def test_a_newer_session_is_refused_and_kept(session):
    path = session.folder / "session.json"
    text = json.dumps({**json.loads(path.read_text()), "version": 2})
    path.write_text(text)
    session.close()
    with pytest.raises(InputError, match="version 2"):
        Session.open(session.folder)
    assert path.read_text() == text


def test_two_apps_do_not_share_a_session(session):
    with pytest.raises(InputError, match="open in another qpal app"):
        Session.open(session.folder)
    again(session).close()


def test_a_write_that_fails_leaves_nothing(session):
    def fails(folder):
        (folder / "log.csv").write_text("half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        session.add(Data(name="x", suffix=".csv"), fails)
    assert sorted(path.name for path in (session.folder / "data").iterdir()) == ["d1", "d2"]
    assert list(session.data) == ["d1", "d2"]


def test_what_a_kill_left_is_removed(session):
    (session.folder / "models" / ".new-abc").mkdir()
    found = again(session)
    assert [path.name for path in (found.folder / "models").iterdir()] == ["m1"]
    assert found.complaints == []
    found.close()


def test_an_entry_is_deleted_with_its_files(session):
    session.remove("data", "d1")
    session.remove("data", "d1")
    found = again(session)
    assert list(found.data) == ["d2"]
    assert not (found.folder / "data" / "d1").exists()
    found.close()


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("../../etc/passwd.csv", "passwd.csv"),
        ("C:\\logs\\thigh.csv", "thigh.csv"),
        ("a\n<script>.csv", "a__script_.csv"),
        ("", "log"),
        ("x" * 500 + ".csv", "x" * 116 + ".csv"),
    ],
)
def test_a_name_from_a_browser_is_a_short_text_without_folders(name, shown):
    assert display_name(name) == shown


@pytest.mark.parametrize("name", ["page.html", "run.py", "log", "archive.tar.gz", ".csv"])
def test_only_logs_are_taken(name):
    with pytest.raises(InputError, match="give a log"):
        suffix_of(name)


def test_a_suffix_from_a_file_cannot_lead_out_of_its_folder():
    with pytest.raises(InputError):
        _ = Data(name="x", suffix="/../../x").file
    with pytest.raises(ValidationError):
        Model.model_validate({**MODEL.model_dump(), "data": "d1/../.."})


@pytest.mark.skipif(os.name != "posix", reason="Windows has no such locks")
def test_the_second_app_is_told_which_process_has_the_session(session):
    with pytest.raises(InputError, match=rf"another qpal app \(process {os.getpid()}\)"):
        Session.open(session.folder)


def test_a_record_with_a_member_that_is_no_array_is_a_sentence(tmp_path):
    from twin.app import samples

    with zipfile.ZipFile(tmp_path / "data.npz", "w") as file:
        file.writestr("u.npy", b"NUMPY no more")
        file.writestr("missing.npy", b"NUMPY no more")
    for load in (samples.load_record, samples.load_runs):
        with pytest.raises(InputError, match=r"data.npz cannot be read \(one of its members is no array\)"):
            load(tmp_path / "data.npz")


def test_a_record_of_another_compression_is_a_sentence(tmp_path):
    from twin.app import samples

    np.savez(tmp_path / "data.npz", u=np.zeros(9), y=np.zeros(9))
    raw = bytearray((tmp_path / "data.npz").read_bytes())
    for mark, place in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        at = raw.find(mark)
        raw[at + place : at + place + 2] = (99).to_bytes(2, "little")
    (tmp_path / "data.npz").write_bytes(raw)
    with pytest.raises(InputError, match=r"data.npz cannot be read .*; add the log"):
        samples.load_record(tmp_path / "data.npz")
