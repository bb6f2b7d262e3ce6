"""Every file of a session that is read back, as no qpal wrote it: a sentence, soon, and without much memory."""

import json
import os
import resource
import signal
import subprocess
import zipfile

import numpy as np
import pytest

from sysid.base.errors import InputError
from sysid.data.record import IOData
from twin.app import samples
from twin.app.desk import Desk
from twin.app.entries import Data, Model, Prepare, Setting, Study
from twin.app.jobs import Jobs
from twin.app.session import Session

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pipes, devices and links of POSIX")
SECONDS, MEMORY = 20, 400  # [s] and [MiB] for a session with one bad file; a thousandth of what it held before
MODEL = Model(
    name="output_error",
    data="d1",
    prepare=Prepare(),
    setting=Setting(structure="output_error"),
    fit_estimation=90.0,
    fit_validation=80.0,
    d=3,
    N=200,
    seconds=1.0,
    converged=True,
)
FILES = [
    "session.json",
    ".lock",
    "rig.toml",
    "rig/run-1.csv",
    "rig/run-2.csv.journal",
    "data/d1/entry.json",
    "data/d1/log.csv",
    "data/d1/record.npz",
    "models/m1/entry.json",
    "models/m1/runs.npz",
    "models/m1/figures.json",
    "models/m1/report.html",
    "models/m1/model.json",
    "studies/s1/entry.json",
    "studies/s1/figures.json",
    "studies/s1/report.html",
]


def sparse(path):
    with path.open("wb") as file:
        file.truncate(2**30)


def bomb(path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name in ("u", "y", "t", "run"):
            with packed.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array_header_1_0(
                    member, {"descr": "<f8", "fortran_order": False, "shape": (2**25,)}
                )
                for _ in range(2**8):
                    member.write(bytes(2**20))


BAD = {
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "link to itself": lambda path: path.symlink_to(path.name),
    "link to another file": lambda path: path.symlink_to("/etc/passwd"),
    "folder": lambda path: path.mkdir(),
    "sparse": sparse,
    "deep": lambda path: path.write_text('{"a":' * 10**5 + "[" * 10**5),
    "deep and closed": lambda path: path.write_text("[" * 10**5 + "]" * 10**5),
    "wrong schema": lambda path: path.write_text('{"free-run": {"figure": 3, "caption": []}, "version": []}'),
    "a number": lambda path: path.write_text("9" * 10**5),
    "bytes": lambda path: path.write_bytes(bytes(range(256)) * 40),
    "empty": lambda path: path.write_bytes(b""),
    "unreadable": lambda path: (path.write_bytes(b"x"), path.chmod(0)),
}


@pytest.fixture
def folder(tmp_path):
    """A whole session."""
    place = tmp_path / "session"
    session = Session.open(place)

    def fill_data(path):
        (path / "log.csv").write_text("time_s,u_V,y_rad\n" + "".join(f"{k},{k % 3},{k % 5}\n" for k in range(50)))
        samples.save_record(IOData(np.arange(9.0) % 4, np.arange(9.0), 0.1), path / "record.npz")

    def fill(path):
        wave = np.arange(9.0)
        words = {"name": np.array("y"), "unit": np.array("rad"), "border": np.array(4.5)}
        np.savez(path / "runs.npz", t=wave, y=wave, run=wave, **words)
        figure = {"data": [{"type": "scatter"}], "layout": {"height": 300}}
        (path / "figures.json").write_text(json.dumps({"run": {"figure": figure, "caption": "run"}}))
        (path / "report.html").write_text("<main><p>all well</p></main>")
        (path / "model.json").write_text("{}")

    session.add(Data(name="one.csv", suffix=".csv"), fill_data)
    session.add(MODEL, fill)
    session.add(Study(kind="compare", data="d1", joint="thigh"), fill)
    (place / "rig").mkdir()
    (place / "rig" / "run-1.csv").write_text("time_s,u_V,y_rad\n0,1,2\n")
    (place / "rig.toml").write_text("")
    session.close()
    return place


def read_back(folder):
    """All that the page reads of a session; what it says of it."""
    said = []
    try:
        desk = Desk(Session.open(folder), Jobs(1))
    except InputError as error:
        return [str(error)]
    desk.jobs._limit = 0
    said += desk.session.complaints
    looks = [
        lambda: desk.record("d1"),
        lambda: desk.runs("m1"),
        lambda: desk.rig.state,
        *(lambda kind=kind, key=key: desk.figures(kind, key) for kind, key in (("models", "m1"), ("studies", "s1"))),
        *(
            lambda kind=kind, key=key, name=name: desk.content(kind, key, name)
            for kind, key in (("models", "m1"), ("studies", "s1"))
            for name in ("report.html", "model.json", "script.py")
        ),
    ]
    for look in looks:
        try:
            look()
        except (InputError, PermissionError) as error:  # the page's route tells an OSError too
            said.append(str(error))
    desk.close()
    return said


def test_a_whole_session_is_read_without_a_word(folder):
    assert read_back(folder) == ["there is no such file in this session"] * 2  # a study has no model


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_file_is_a_sentence_soon_and_in_little_memory(folder, kind):
    def give_up(number, frame):
        raise AssertionError("it hangs")

    kept = folder.with_name("kept")
    signal.signal(signal.SIGALRM, give_up)
    subprocess.run(["cp", "-a", folder, kept], check=True)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name in FILES:
        subprocess.run(["rm", "-rf", folder], check=True)
        subprocess.run(["cp", "-a", kept, folder], check=True)
        (folder / name).unlink(missing_ok=True)
        BAD[kind](folder / name)
        signal.alarm(SECONDS)
        said = read_back(folder)
        signal.alarm(0)
        assert all(len(sentence) < 400 for sentence in said), name
        if name not in (
            ".lock",
            "rig.toml",
            "rig/run-1.csv",
            "rig/run-2.csv.journal",
            "models/m1/model.json",
            "data/d1/log.csv",
        ):
            assert len(said) > 2 or "session" in said[0], name
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024 < MEMORY


def test_a_packed_record_that_unpacks_to_a_gigabyte_is_not_unpacked(tmp_path):
    bomb(tmp_path / "record.npz")
    assert (tmp_path / "record.npz").stat().st_size < 2**21
    for load in (samples.load_record, samples.load_runs):
        with pytest.raises(InputError, match="larger than 512 MiB"):
            load(tmp_path / "record.npz")


@pytest.mark.parametrize("name", ["data", "models", "models/m1", "rig"])
def test_a_folder_that_is_a_link_leads_nowhere(folder, tmp_path, name):
    elsewhere = tmp_path / "elsewhere"
    (folder / name).rename(elsewhere)
    (elsewhere / ".new-mine").mkdir()
    (folder / name).symlink_to(elsewhere)
    before = sorted(path.name for path in elsewhere.rglob("*"))
    said = read_back(folder)
    assert name == "rig" or "is a link" in said[0]
    assert sorted(path.name for path in elsewhere.rglob("*")) == before
