"""The rig behind the page, without a browser: what is played is what the session gets, and what turns the drive off."""

import ast
import os
import re
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("serial", reason="the rig needs pyserial: pip install 'qpal[rig]'")

from app_served import PATIENCE

import twin.rig
from twin.app.desk import Desk
from twin.app.jobs import Jobs
from twin.app.rig import OFF, READY, Seen
from twin.app.rig_figure import WINDOW, live
from twin.app.rig_line import CLOSED, SILENT
from twin.app.rig_words import words_of_page
from twin.app.session import Session
from twin.rig import calibration as calibrations
from twin.rig import wire
from twin.rig.calibration import Calibration
from twin.rig.emulator import Emulator
from twin.rig.link import Link

TS = 0.02


@contextmanager
def desk_in(folder):
    desk = Desk(Session.open(folder), Jobs(1))
    try:
        yield desk
    finally:
        desk.close()


def until(rig, look, beats=True):
    """Wait as a page does: beats go out, and an emulated leg's own angle is the answer to each question."""
    end = time.monotonic() + PATIENCE
    while not look():
        assert time.monotonic() < end, (rig.state, rig.problems, rig.said)
        if beats:
            rig.beat()
        time.sleep(0.02)


def connect(rig, port):
    rig.connect(port)
    until(rig, lambda: rig.state in (READY, OFF))
    assert rig.state == READY, rig.problems


def driven(emulator):
    return emulator.board.state in (wire.ARMED, wire.RUNNING) or any(emulator.plant._queue)


def seconds_until_off(emulator, act):
    """From the act to the first moment at which the bridge gets nothing."""
    assert driven(emulator)
    began = time.monotonic()
    act()
    while driven(emulator):
        assert time.monotonic() - began < PATIENCE
        time.sleep(0.002)
    return time.monotonic() - began


def calibration_of(emulator):
    """Wiring and ends by the data sheet, as the wire check and the run to the ends would find them."""
    plant = emulator.plant
    return Calibration(
        port=emulator.port,
        joint=emulator.joint,
        channel=plant.channel,
        motor_reversed=plant.motor_sign != plant.sensor_sign,
        low_counts=0.0,
        low_angle=plant.angle_of(0),
        high_counts=float(plant.full),
        high_angle=plant.angle_of(plant.full),
        soft_low=-2.0,
        soft_high=2.0,
        crossing=2.0,
        stall=30.0,
    )


def write_design(path, u, Ts=TS):
    rows = "".join(f"{k * Ts:.6g},{level:.6g}\n" for k, level in enumerate(u))
    path.write_text("time [s],u [V]\n" + rows)
    return path


@pytest.fixture
def moving(tmp_path, monkeypatch):
    """A context of a session whose rig plays slow steps on an emulated leg: `with moving(speed=1.0) as (desk, leg)`."""

    monkeypatch.setattr("twin.rig.emulator.PATIENCE", 5.0)  # of a busy machine, which a board does not wait for

    @contextmanager
    def made(speed):
        with Emulator("shoulder", 1, speed=speed) as emulator, desk_in(tmp_path / "s") as desk:
            calibrations.write(calibration_of(emulator), tmp_path / "s" / "rig.toml")
            rig = desk.rig
            connect(rig, emulator.port)
            design = write_design(tmp_path / "long.csv", np.repeat(np.tile([6.0, -6.0], 40), 50))
            rig.choose("upload", "long.csv", design)
            until(rig, lambda: rig.state == READY)
            rig.run()
            until(rig, lambda: len(rig.seen.rows) > 20 or "run" in rig.problems)
            assert rig.problems == {}
            yield desk, emulator

    return made


def test_what_was_played_on_a_leg_that_was_wired_here_is_a_record_of_the_session(tmp_path, monkeypatch):
    """Against the emulated bridge and sensor themselves: each duty of a millisecond, each reading of a sample."""
    played, read = [], []
    with Emulator("shoulder", 3) as emulator, desk_in(tmp_path / "s") as desk:
        rig, plant = desk.rig, emulator.plant
        step, reading = plant.step, plant.reading

        def step_and_note(duties):
            if plant.logs:
                played.append(duties[plant.channel])
            step(duties)

        def read_and_note(joint):
            counts = reading(joint)
            if plant.logs and joint == plant.channel:
                read.append(counts)
            return counts

        monkeypatch.setattr(plant, "step", step_and_note)
        monkeypatch.setattr(plant, "reading", read_and_note)
        connect(rig, emulator.port)
        until(rig, lambda: rig.seen.readings)
        assert abs(rig.seen.readings[0] - plant.position(0)) < 10.0
        assert rig.port.firmware == "qpal twin 1.0.0"

        rig.find_ends()
        assert "check the wiring first" in rig.problems["zero"]
        rig.find_wiring("shoulder", 0, 12.0, 12.0)
        until(rig, lambda: rig.state == READY)
        assert rig.problems == {}
        assert rig.calibration.motor_reversed == (plant.motor_sign != plant.sensor_sign)
        assert any("% of the supply moves it by" in sentence for sentence in rig.said)

        rig.find_ends()
        for end in ("low", "high"):
            until(rig, lambda end=end: rig.question is not None and rig.question.end == end)
            assert not driven(emulator)  # nothing moves while a person measures
            rig.answer(None)
            assert "angle in degrees" in rig.problems["question"]
            rig.answer(float(np.rad2deg(plant.angle_of(rig.question.counts))))
        until(rig, lambda: rig.state == READY)
        assert rig.problems == {}
        calibration = calibrations.read(tmp_path / "s" / "rig.toml")
        assert calibration == rig.calibration
        assert calibration.is_zeroed

        u = np.repeat(np.random.default_rng(5).uniform(-11.0, 11.0, 12), 25)
        rig.choose("upload", "steps.csv", write_design(tmp_path / "steps.csv", u))
        until(rig, lambda: rig.state == READY)
        assert rig.chosen.words == f"300 levels, one every 0.02 s: 6.0 s, at most {np.abs(u).max():.2f} V"
        played.clear()
        read.clear()
        rig.run()
        until(rig, lambda: rig.state == READY)
        assert rig.problems == {}
        until(rig, lambda: all(job.over for job in desk.jobs.all))
        record, entry = desk.record(rig.record), desk.session.data[rig.record]
        assert (entry.name, entry.joint) == ("rig shoulder, steps.csv", "shoulder")
        assert (record.N, record.Ts, record.u_unit, record.y_unit) == (300, TS, "V", "rad")
        raises = plant.motor_sign  # a duty at the bridge, after the board's own sign, turns the leg this way
        means = raises * np.mean(np.reshape(played, (300, 20)), axis=1)
        assert np.abs(record.u[:, 0] - means / wire.FULL * 12.0).max() < 0.51 / wire.FULL * 12.0
        assert np.ptp(record.u) > 15.0
        assert record.y[:, 0] == pytest.approx(
            np.array([plant.angle_of(counts) for counts in read]), abs=0.01 * plant.count
        )
        assert desk.session.head.shown == rig.record
        rows = np.array(rig.seen.rows)
        assert len(rows) == 300
        assert calibration.angle(rows[:, 1]) == pytest.approx(record.y[:, 0], abs=1e-6)


def test_stop_turns_the_drive_off_and_keeps_the_log(moving):
    with moving(speed=1.5) as (desk, emulator):
        rig = desk.rig
        rig.run()
        assert "busy with a run" in rig.problems["run"]  # a second window
        rig.find_wiring("shoulder", 0, 12.0, 12.0)
        assert "busy with a run" in rig.problems["wire"]
        assert seconds_until_off(emulator, rig.stop) < 0.5
        until(rig, lambda: rig.state == READY)
        assert rig.problems["run"] == "the run ended early: it was stopped by hand; the drive is off"
        assert desk.session.data[rig.record].name == "rig shoulder, long.csv"
        rig.stop()  # nothing moves: no harm
        rig.seen.readings = ()
        until(rig, lambda: rig.seen.readings)


def test_a_page_that_no_longer_answers_is_a_stop(moving):
    with moving(speed=1.5) as (desk, emulator):
        assert seconds_until_off(emulator, lambda: None) < SILENT + 1.5
        until(desk.rig, lambda: desk.rig.state == READY, beats=False)
        assert CLOSED in desk.rig.problems["run"]


def test_a_line_that_is_killed_leaves_the_drive_off_and_a_sentence(moving, monkeypatch):
    with moving(speed=1.5) as (desk, emulator):
        monkeypatch.setattr("twin.rig.emulator.PATIENCE", wire.LINK)  # as the firmware, now that nobody speaks
        assert seconds_until_off(emulator, desk.rig._process.kill) < 0.5
        assert emulator.board.state == wire.FAILED
        until(desk.rig, lambda: desk.rig.state == OFF)
        assert "ended the process" in desk.rig.problems["connect"]


def test_a_pulled_cable_leaves_the_log_and_a_sentence(moving):
    with moving(speed=1.5) as (desk, emulator):
        emulator.pull()
        until(desk.rig, lambda: desk.rig.state == OFF)
        assert "the connection is lost" in desk.rig.problems["connect"]
        assert desk.rig.record in desk.session.data


def test_a_log_whose_app_was_killed_is_taken_in_when_the_session_opens_again(tmp_path):
    with desk_in(tmp_path / "s"):
        pass
    (tmp_path / "s" / "rig").mkdir()
    write_design(tmp_path / "s" / "rig" / "run-20260101-120000.csv", np.ones(50))
    with desk_in(tmp_path / "s") as desk:
        assert [entry.name for entry in desk.session.data.values()] == ["rig, run-20260101-120000"]
        assert not list((tmp_path / "s" / "rig").iterdir())


def test_a_port_that_another_program_holds_or_that_is_none_is_a_sentence(tmp_path):
    document = tmp_path / "thesis.tex"
    document.write_text("x")
    with Emulator("shoulder", 1) as emulator, Link(emulator.port), desk_in(tmp_path / "s") as desk:
        for port, said in (
            (emulator.port, "another program holds this port, perhaps another qpal app"),
            ("/dev/ttyNOPE", "there is no such port"),
            (str(document), "thesis.tex"),
            (" ", "no port is chosen"),
        ):
            desk.rig.connect(port)
            until(desk.rig, lambda: desk.rig.state == OFF)
            assert said in desk.rig.problems["connect"]
        desk.rig.connect(None, "knee")
        assert "shoulder, thigh, shank" in desk.rig.problems["connect"]
    assert document.read_text() == "x"


def test_a_port_that_answers_something_else_is_a_sentence(tmp_path):
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    with desk_in(tmp_path / "s") as desk:
        desk.rig.connect(os.ttyname(slave))
        until(desk.rig, lambda: os.write(master, b"ok\r\n") and desk.rig.state == OFF)
        assert "none is a rig's answer" in desk.rig.problems["connect"]
        assert "choose another port" in desk.rig.problems["connect"]
    os.close(master)
    os.close(slave)


def test_bad_input_is_a_sentence_at_its_place_and_moves_nothing(tmp_path):
    with Emulator("shoulder", 1) as emulator, desk_in(tmp_path / "s") as desk:
        rig, before = desk.rig, emulator.plant.position(0)
        rig.run()
        assert "no input is chosen" in rig.problems["run"]
        rig.find_wiring("shoulder", 0, 12.0, 12.0)
        assert "no rig is connected" in rig.problems["wire"]
        connect(rig, emulator.port)
        rig.connect(emulator.port)
        assert "has a rig already" in rig.problems["connect"]
        for joint, channel, supply, largest, said in (
            ("shoulder", 7, 12.0, 12.0, "channel"),
            ("shoulder", None, 12.0, 12.0, "a number is missing"),
            ("shoulder", 0.5, 12.0, 12.0, "give 0, 1 or 2"),
            ("shoulder", 0, 12.0, 24.0, "largest is 24 V"),
            ("", 0, 12.0, 12.0, "joint"),
        ):
            rig.find_wiring(joint, channel, supply, largest)
            until(rig, lambda: rig.state == READY)
            assert said in rig.problems["wire"]
        (tmp_path / "bad.toml").write_text("port = 3")
        for path, said in ((tmp_path / "none.toml", "No such file"), (tmp_path / "bad.toml", "port")):
            rig.use(str(path))
            assert said in rig.problems["calibration"]
            assert "qpal rig" not in rig.problems["calibration"]
        assert not (tmp_path / "s" / "rig.toml").exists()
        good = calibrations.write(calibration_of(emulator).model_copy(update={"largest": 9.0}), tmp_path / "good.toml")
        rig.use(str(good))
        assert calibrations.read(tmp_path / "s" / "rig.toml") == rig.calibration == calibrations.read(good)
        (tmp_path / "words.csv").write_text("a,b\n" + "x,y\n" * 20)
        (tmp_path / "two.csv").write_text("time [s],u1 [V],u2 [V]\n" + "".join(f"{k * TS},1,2\n" for k in range(50)))
        for file, said in (
            (write_design(tmp_path / "high.csv", np.full(50, 9.5)), "choose an input of at most 9 V"),
            (write_design(tmp_path / "few.csv", np.ones(5)), "has 5 samples"),
            (tmp_path / "words.csv", "words.csv"),
            (tmp_path / "two.csv", "columns time [s] and u [V]"),
        ):
            rig.choose("upload", file.name, file)
            until(rig, lambda: rig.state == READY)
            assert said in rig.problems["input"]
            assert str(tmp_path) not in rig.problems["input"]
            assert "--" not in rig.problems["input"]
            assert rig.chosen is None
        assert emulator.plant.position(0) == before
        assert emulator.board.state == wire.OFF


def test_an_emulated_leg_never_replaces_the_calibration_of_a_real_one(tmp_path):
    with desk_in(tmp_path / "s") as desk:
        (tmp_path / "s" / "rig.toml").write_text("port = 3")
        desk.rig.connect(None, "shank", 4, 50.0)
        until(desk.rig, lambda: desk.rig.state in (READY, OFF))
        assert desk.rig.problems == {}
        assert desk.rig.file == tmp_path / "s" / "rig-shank-4.toml"
        assert desk.rig.port.name == "emulated shank, seed 4"


def test_no_sentence_of_the_rig_speaks_of_an_option_of_the_command_line():
    texts, parts_of_others = [], set()
    for name in ("calibration", "link", "room", "run", "wiring"):
        for node in ast.walk(ast.parse((Path(twin.rig.__file__).parent / f"{name}.py").read_text())):
            if isinstance(node, ast.JoinedStr):
                parts_of_others |= set(map(id, node.values))
                texts.append("".join(part.value if isinstance(part, ast.Constant) else "7" for part in node.values))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts_of_others:
                texts.append(node.value)
    named = [text for text in texts if re.search(r"qpal rig |(?<!-)--[a-z]", text) and "\n" not in text and " " in text]
    assert len(named) > 8
    for text in named:
        left = words_of_page(text).replace("qpal rig in a terminal", "")
        assert not re.search(r"qpal rig|--[a-z]", left), text


def test_the_live_figure_shows_the_last_seconds_in_degrees_and_volts():
    calibration = Calibration(
        port="x",
        joint="thigh",
        channel=0,
        low_counts=100.0,
        low_angle=1.0,
        high_counts=900.0,
        high_angle=-1.0,
        soft_low=-1.1,
        soft_high=1.1,
    )
    t = np.arange(1500) * TS
    rows = [(float(s), 500, 511, 400 if s < 1 else 380, 2 if s > 29.9 else 0) for s in t]
    figure = live(Seen(rows, (), calibration), 1023)
    by_name = {trace["name"]: trace for trace in figure["data"]}
    low, high = figure["layout"]["xaxis"]["range"]
    assert high - low == pytest.approx(WINDOW)
    assert low < t[-1] < high
    assert _numbers(by_name["measured"]["y"]) == pytest.approx(
        np.zeros(len(_numbers(by_name["measured"]["y"]))), abs=1e-9
    )
    assert _numbers(by_name["played"]["y"]) == pytest.approx(-511 / 1023 * 12.0)  # the angle falls with the counts
    assert _numbers(by_name["supply"]["y"]) == pytest.approx(95.0)
    assert min(_numbers(by_name["motor cut at a limit"]["x"])) > 29.9
    raw = live(Seen(rows, (), None), 1023)
    assert _numbers(raw["data"][0]["y"]) == pytest.approx(500.0)
    assert live(Seen(), 1023)["layout"]["xaxis"]["range"] == [0.0, WINDOW]


def _numbers(values):
    """Of a list, or of plotly's packed array."""
    if isinstance(values, dict):
        import base64

        return np.frombuffer(base64.b64decode(values["bdata"]), dtype=values["dtype"]).astype(float)
    return np.array(values, dtype=float)
