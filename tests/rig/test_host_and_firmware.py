"""The host on the real firmware, executed by simavr in front of the twin's leg: the whole cable in one test."""

import numpy as np
import pytest

import twin
from twin.cli import main
from twin.experiment import SETTLE
from twin.plant.stepping import step
from twin.rig import avr, wire
from twin.rig import calibration as calibrations
from twin.rig.avr import Avr, Port
from twin.rig.calibration import Calibration
from twin.rig.leg import ELSEWHERE, LegPlant, drawn_leg
from twin.rig.link import Link
from twin.rig.run import Input, check_input, log_of, play
from twin.rig.wiring import read_sensors
from twin.studies.beyond import twin_truth

pytestmark = pytest.mark.skipif(bool(avr.missing()), reason=avr.missing())
TS = 0.02


def test_the_host_plays_the_twin_through_the_real_firmware(steps):
    """4 s in real time; what comes back is what the twin does under the voltages that were logged."""
    experiment = twin.Experiment("shoulder", "sweep", 4.0, TS, 5, (*ELSEWHERE, "noise", "adc"))
    leg = LegPlant(experiment, motor_sign=-1, sensor_sign=1)

    def plant(duties, seconds):
        leg.step([wire.FULL * duty for duty in duties])
        return [*(leg.position(j) / leg.full for j in range(3)), leg.supply() / leg.full]

    with Port(Avr(plant)) as board, Link(board.port) as link:
        full = link.identity.full
        assert (link.identity.joints, link.identity.ring) == (wire.JOINTS, wire.RING)
        assert read_sensors(link).mean[0] == pytest.approx(leg.position(0) / leg.full * full, abs=0.003 * full)
        calibration = Calibration(
            port=board.port,
            joint="shoulder",
            channel=0,
            motor_reversed=True,
            slew=1e5,
            low_counts=0.0,
            low_angle=leg.angle_of(0),
            high_counts=float(full),
            high_angle=leg.angle_of(leg.full),
            soft_low=-0.65,
            soft_high=0.65,
        )
        u = 0.8 * steps(200)
        recording = play(link, calibration.setup(full), check_input(Input(u, TS), calibration), TS)
        log = log_of(recording, calibration, link)
    assert recording.reason == ""
    assert len(recording.lost) == 0
    assert log.u == pytest.approx(u, abs=0.02)
    direct = twin.Experiment("shoulder", "sweep", 4.0, TS, 5, experiment.without)
    run = direct.prepare(u=log.u[:, None])
    expected = direct.record(run, step([run], TS, SETTLE)[0])
    assert np.ptp(expected.y) > 0.3
    # The board reads commands every 10 ms, at another phase than in the twin; a millivolt of noise is on its converter.
    assert np.abs(log.y - expected.y).max() < 0.02
    assert np.sqrt(np.mean((log.y - expected.y) ** 2)) < 0.01


@pytest.mark.long
def test_the_verbs_drive_the_real_firmware(tmp_path, monkeypatch, capsys):
    """The leg of a seed behind simavr, in real time: its ends in the firmware's counts, and an input that is played."""
    monkeypatch.chdir(tmp_path)
    rig = ("--emulate", "firmware", "--seed", "1", "--yes")
    assert main(["rig", "wire", "shoulder", *rig]) == 0
    assert main(["rig", "zero", *rig]) == 0
    assert "Next: qpal rig auto shoulder --rig rig.toml --emulate firmware --seed 1" in capsys.readouterr().out
    found = calibrations.read("rig.toml")
    leg = drawn_leg("shoulder", 1)
    true = twin_truth("shoulder", TS, leg.experiment.p)
    assert found.board == "qpal-mega2560 0.1.0, seed 1"
    assert found.motor_reversed == (leg.motor_sign != leg.sensor_sign)
    ends = sorted((found.low_angle, found.high_angle))
    assert ends == pytest.approx([true["end_low"], true["end_high"]], abs=true["backlash"] + 0.03)
    assert abs(found.scale) == pytest.approx(leg.count / 4, rel=0.01)  # four conversions are a reading
    u = np.repeat([8.0, -8.0], 50)
    table = np.column_stack([TS * np.arange(100), u])
    np.savetxt("d.csv", table, delimiter=",", header="time [s],u [V]", comments="")
    assert main(["rig", "run", "d.csv", *rig, "--log", "o.csv"]) == 0
    log = twin.Log.load("o.csv")
    assert log.meta["rig"]["firmware"] == "qpal-mega2560 0.1.0"
    assert log.u[:45] == pytest.approx(8.0, abs=0.5)
    assert log.y[49] - log.y[0] > 0.1  # a positive voltage raises the angle
    assert np.std(np.diff(log.y, 2)[:20]) < 3.0 * leg.pot.noise


def test_a_simulator_that_is_missing_is_named(monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    assert main(["rig", "find", "--emulate", "firmware"]) == 2
    assert "the firmware needs avr-gcc, gcc, make to be run here; install Debian's gcc-avr" in capsys.readouterr().err
