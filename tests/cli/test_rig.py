"""`qpal rig` as its user meets it, with the twin behind the emulated cable."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("serial", reason="the rig needs pyserial: pip install 'qpal[rig]'")

import twin
from sysid.base.errors import InputError
from twin.cli import main
from twin.cli.console import Interruption
from twin.cli.keeping import kept_logs
from twin.rig import calibration as calibrations
from twin.rig.emulator import Emulator
from twin.rig.link import Link
from twin.rig.run import play

TS = 0.02
RIG = ("--emulate", "twin", "--seed", "1")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """The calibration of the emulated shoulder 1, as wire and zero write it."""
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    assert main(["rig", "wire", "shoulder", *RIG, "--yes", "--rig", str(path)]) == 0
    assert main(["rig", "zero", *RIG, "--yes", "--rig", str(path)]) == 0
    return path


def write_input(u, name="design.csv"):
    t = np.arange(len(u)) * TS
    np.savetxt(name, np.column_stack([t, u]), fmt="%.9g", delimiter=",", header="time [s],u [V]", comments="")


def refused(arguments, capsys, code=2):
    before = sorted(Path().rglob("*"))
    assert main(arguments) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("qpal: ")
    assert err.count("\n") == 1
    assert sorted(Path().rglob("*")) == before
    return err


def test_wire_and_zero_write_what_the_leg_is(known):
    c = calibrations.read(known)
    with Emulator("shoulder", 1) as emulator:
        true, plant = emulator.truth(TS), emulator.plant
    assert c.motor_reversed == (plant.motor_sign != plant.sensor_sign)
    assert np.sign(c.scale) == plant.sensor_sign
    ends = sorted((c.low_angle, c.high_angle))
    assert ends == pytest.approx([true["end_low"], true["end_high"]], abs=true["backlash"] + 0.01)
    assert c.soft_low < ends[0] < ends[1] < c.soft_high
    # From end to end at full voltage: the way, by speed per volt times volts beyond friction.
    ideal = (ends[1] - ends[0]) / (true["speed_per_volt"] * (12.0 - max(true["coulomb_up"], -true["coulomb_down"])))
    assert c.crossing == pytest.approx(ideal, rel=0.3)
    assert "# [V/s] fastest change of the input" in known.read_text()


def test_a_run_writes_a_log_that_is_read(known, capsys):
    u = np.repeat([6.0, -6.0, 9.0, 0.0], 60)
    write_input(u)
    assert main(["rig", "run", "design.csv", *RIG, "--rig", str(known), "--yes", "--log", "o.csv", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["samples"], summary["lost"], summary["notes"]) == (240, 0, [])
    log = twin.Log.load("o.csv")
    assert (log.joint, log.Ts, log.N) == ("shoulder", TS, 240)
    off = np.abs(log.u - u)
    jumps = np.r_[False, np.diff(u) != 0.0]
    assert off[~jumps].max() < 12.0 / 1023  # a duty has 1023 steps
    assert off[jumps].max() < 0.05 * 15.0  # and takes a millisecond more of a sample to turn round
    assert log.y[60] - log.y[0] > 0.1  # a positive voltage raises the angle
    assert log.meta["rig"]["firmware"] == "qpal twin 1.0.0"
    assert sorted(p.name for p in Path().iterdir()) == ["design.csv", "o.csv"]
    assert main(["info", "o.csv", "--json"]) == 0


def test_a_run_that_ends_early_keeps_its_log_and_says_why(known, capsys):
    """The joint is driven into its end, beyond which no soft limit excuses that it stands still."""
    c = calibrations.read(known)
    loose = c.model_copy(update={"soft_low": c.soft_low - 0.3, "soft_high": c.soft_high + 0.3, "stall": 1.0})
    calibrations.write(loose, "loose.toml")
    write_input(np.full(400, 8.0))
    assert main(["rig", "run", "design.csv", *RIG, "--rig", "loose.toml", "--yes", "--log", "o.csv"]) == 1
    out, err = capsys.readouterr()
    assert "the run ended early: it did not move under drive (stall); the drive is off, the first" in err
    assert "Next:" not in out  # what is there may be too short
    log = twin.Log.load("o.csv")
    assert 50 < log.N < 400
    assert log.y[-1] == pytest.approx(c.soft_high, abs=0.06)
    assert "stall" in log.meta["rig"]["ended_early"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["find", "--port", "nowhere"], "nowhere: there is no such port"),
        (["wire", "elbow", *RIG, "--yes"], "choose one of shoulder, thigh, shank"),
        (["wire", "shoulder", *RIG], "To confirm where nobody can be asked, give --yes"),
        (["wire", "shoulder", "--emulate", "dog", "--yes"], "unknown emulated rig 'dog'"),
        (["wire", "shoulder", *RIG, "--yes", "--rig", "rig.json"], "end its name in .toml"),
        (["wire", "shoulder", *RIG, "--yes", "--largest", "20"], "largest is 20 V and the supply has 12 V"),
        (["wire", "shoulder", "--yes"], "no port is given; see qpal rig find"),
        (["zero", "--rig", "none.toml"], "make it with qpal rig wire"),
        (["run", "none.csv", *RIG, "--yes"], "none.csv"),
        (["auto", "shoulder", *RIG, "--experiments", "0"], "give positive numbers"),
    ],
)
def test_bad_input_gets_a_sentence(arguments, said, capsys):
    assert said in refused(["rig", *arguments], capsys)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["zero", "--low", "nan", "--high", "5"], "--low is nan; give an angle from -720 to 720 degrees"),
        (["zero", "--low", "5", "--high", "5"], "--low and --high are both 5; give the angle of each end"),
        (["zero", "--emulate", "twin", "--seed", "2"], "wire it by qpal rig wire shoulder --rig other.toml --emulate"),
        (["run", "design.csv", "--emulate", "twin", "--seed", "2"], "here answers qpal twin 1.0.0, seed 2"),
        (["auto", "shoulder", "--emulate", "twin", "--seed", "2"], "is of another board: qpal twin 1.0.0, seed 1"),
        (["run", "design.csv", "--emulate", "firmware", "--speed", "2"], "in the time of a clock; leave --speed out"),
        (["run", "design.csv", "--ts", "0.02", "--time", "u [V]"], "design.csv"),
    ],
)
def test_what_does_not_fit_the_rig_is_refused_before_it_moves(known, arguments, said, capsys, monkeypatch):
    for name in ("run", "wiring", "auto"):
        monkeypatch.setattr(f"twin.rig.{name}.play", lambda *_: pytest.fail("it moved"))
    write_input(np.full(100, 5.0))
    Path("rig.toml").write_text(known.read_text())
    emulated = () if "--emulate" in arguments else RIG
    assert said in refused(["rig", *arguments, *emulated, "--yes"], capsys)


def test_wire_refuses_a_supply_that_is_another(capsys):
    said = refused(["rig", "wire", "shoulder", *RIG, "--yes", "--supply", "24"], capsys)
    assert "the supply measures 12.0 V and should have 24 V" in said
    assert main(["rig", "wire", "shoulder", *RIG, "--yes", "--supply", "24", "--supply-full", "37", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["supply_full"] == 37.0


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="who is root may write everywhere")
def test_a_folder_that_cannot_be_written_is_told_before_it_moves(known, capsys):
    Path("ro").mkdir()
    Path("ro/rig.toml").write_text(known.read_text())
    Path("ro").chmod(0o555)
    for verb in (["wire", "shoulder"], ["zero"]):
        assert "permission denied" in refused(["rig", *verb, *RIG, "--yes", "--rig", "ro/rig.toml"], capsys)
    Path("ro").chmod(0o755)


def test_a_place_that_cannot_be_written_is_told_before_it_moves(known, capsys):
    assert "there is no folder no" in refused(["rig", "wire", "shoulder", *RIG, "--yes", "--rig", "no/r.toml"], capsys)
    Path("folder.toml").mkdir()
    assert "it is a folder" in refused(["rig", "wire", "shoulder", *RIG, "--yes", "--rig", "folder.toml"], capsys)


def test_a_design_beyond_the_limits_is_refused(known, capsys):
    write_input(np.full(100, 12.5))
    arguments = ["rig", "run", "design.csv", *RIG, "--rig", str(known), "--yes"]
    assert "reaches 12.5 V at 0 s, and the rig's largest input is 12 V" in refused(arguments, capsys)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("supply = -1", "supply: Input should be greater than 0"),
        ("volts = 3", "volts: Extra inputs are not permitted"),
        ("low_counts = 3.0", "some values of the ends are missing; run qpal rig zero again"),
        ("port = 3 3", "is no TOML file"),
    ],
)
def test_a_damaged_calibration_gets_a_sentence(line, said, capsys):
    Path("rig.toml").write_text(f'port = "p"\njoint = "thigh"\nchannel = 1\n{line}\n')
    assert said in refused(["rig", "zero", "--rig", "rig.toml"], capsys)


def test_a_full_disk_is_met_before_anything_moves(known, capsys, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    write_input(np.full(100, 5.0))
    monkeypatch.setattr("os.posix_fallocate", full)
    monkeypatch.setattr("twin.rig.run.play", lambda *_: pytest.fail("it moved"))
    said = refused(["rig", "run", "design.csv", *RIG, "--rig", str(known), "--yes"], capsys)
    assert "no room for the log of about 0.0 MB (No space left on device); nothing was moved" in said


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_keeps_the_log(known):
    """In real time, in a process of its own."""
    write_input(np.where(np.arange(3000) // 50 % 2 == 0, 6.0, -6.0))
    command = [sys.executable, "-m", "twin.cli", "rig", "run", "design.csv", *RIG, "--rig", str(known), "--yes"]
    root = str(Path(twin.__file__).parents[1])
    env = os.environ | {"PYTHONPATH": root}
    process = subprocess.Popen(
        [*command, "--log", "o.csv", "--speed", "1"], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=env
    )
    end = time.monotonic() + 60.0
    while not list(Path().glob(".o*")) and process.poll() is None and time.monotonic() < end:
        time.sleep(0.05)  # the log's room on the disk: from now on it moves
    time.sleep(2.0)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "qpal: stopped; the drive is off; the first" in err
    log = twin.Log.load("o.csv")
    assert 20 < log.N < 1000
    assert "stopped by hand" in log.meta["rig"]["ended_early"]
    assert sorted(p.name for p in Path().iterdir()) == ["design.csv", "o.csv"]


@pytest.mark.nightly
@pytest.mark.long
def test_auto_comes_from_a_plugged_in_rig_to_values(capsys):
    code = main(["rig", "auto", "shoulder", *RIG, "--yes", "--out", "o", "--json"])
    summary = json.loads(capsys.readouterr().out)
    assert code == (1 if summary["not_determined"] else 0)
    assert summary["rig_seconds"] < 600.0
    assert 2 <= len(summary["experiments"]) <= 3
    assert len(summary["values"]) >= 5
    true = summary["truth"]
    for value in summary["values"]:
        if value["determined"]:
            assert value["value"] == pytest.approx(true[value["name"]], rel=0.25, abs=0.6), value["name"]
    files = {path.name for path in Path("o").iterdir()}
    assert {"summary.json", "report.html", "figures", "experiment-1.csv", "experiment-2.csv"} <= files
    assert (Path("o") / "figures" / "intervals.png").is_file()


def test_two_hosts_are_one_too_many(known, capsys):
    with Emulator("shoulder", 1) as emulator, Link(emulator.port) as link:
        assert "another program holds this port" in refused(["rig", "find", "--port", emulator.port], capsys)
        c = calibrations.read(known)
        assert play(link, c.setup(1023), np.zeros(20, dtype=int), TS).reason == ""  # the first one goes on


def test_a_log_is_not_overwritten_and_a_named_rig_has_to_exist(known, capsys):
    write_input(np.zeros(20))
    Path("o.csv").write_text("an hour at the rig")
    run = ["rig", "run", "design.csv", *RIG, "--yes"]
    assert "o.csv is there already" in refused([*run, "--rig", str(known), "--log", "o.csv"], capsys)
    assert Path("o.csv").read_text() == "an hour at the rig"
    assert "design.csv is there already" in refused([*run, "--rig", str(known), "--log", "design.csv"], capsys)
    assert "other.toml" in refused([*run, "--rig", "other.toml", "--log", "new.csv"], capsys)


def test_logs_of_experiments_outlast_what_stops_them():
    log = twin.Log(np.zeros(60), np.linspace(0.0, 1.0, 60), TS, None, "thigh", {})
    folder, scratch = Path("out"), Path("scratch")
    scratch.mkdir()

    def stopped(by):
        with kept_logs(folder, scratch) as kept:
            kept.save(1, log)
            assert Path("out-logs/experiment-1.csv").exists()  # also for a process that is killed now
            raise by

    for stop, said in ((KeyboardInterrupt, "the logs are in out-logs"), (InputError("cut"), "cut; the logs are in")):
        with pytest.raises((Interruption, InputError), match=said):
            stopped(stop)
        assert twin.Log.load("out-logs/experiment-1.csv").N == 60
        with pytest.raises(InputError, match="out-logs has the logs"), kept_logs(folder, scratch):
            pass
        Path("out-logs").rename(f"moved-{said[:3]}")
    with kept_logs(folder, scratch) as kept:
        kept.save(1, log)
    assert (scratch / "experiment-1.csv").exists()
    assert not Path("out-logs").exists()
    scratch.rename(folder)
    scratch.mkdir()
    with pytest.raises(InputError, match="out has the logs of a former run"), kept_logs(folder, scratch):
        pass
    assert [path.name for path in folder.iterdir()] == ["experiment-1.csv"]
