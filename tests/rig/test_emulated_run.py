"""A run on the emulated rig against the twin itself, and what happens to frames that do not arrive."""

import numpy as np
import pytest

import twin
from sysid.base.errors import InputError
from sysid.channels.guess import Given
from sysid.workflow.record import read_record
from twin.experiment import SETTLE
from twin.plant.stepping import step
from twin.rig import wire
from twin.rig.leg import ELSEWHERE
from twin.rig.run import Input, check_input, log_of, play, read_input

TS = 0.02
TIMES, LEVELS = [round(0.02 * k, 9) for k in range(50)], [(-1) ** (k // 5) * 3.0 for k in range(50)]


def played(rig, u, **settings):
    with rig(**settings) as (emulator, link, calibration):
        recording = play(link, calibration.setup(link.identity.full), check_input(Input(u, TS), calibration), TS)
        return recording, log_of(recording, calibration, link), emulator


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_a_run_is_what_the_twin_does_under_the_played_levels(rig, steps, signs):
    """Every reading, noise and converter included, whichever way motor and sensor are wired."""
    recording, log, emulator = played(rig, steps(), signs=signs, changes={"slew": 1e5})
    assert recording.reason == ""
    assert not recording.limits.any()
    duty = np.round(steps() / 12.0 * 1023)
    assert log.u == pytest.approx(duty / 1023 * 12.0, abs=1e-12)
    e = emulator.plant.experiment
    direct = twin.Experiment(e.joint, "sweep", 8.0, TS, e.seed, ELSEWHERE, e.p)
    run = direct.prepare(u=log.u[:, None])
    expected = direct.record(run, step([run], TS, SETTLE)[0])
    same = np.abs(log.y - expected.y) < 1e-9
    # A sensor that is wired the other way round rounds halves the other way: some readings differ by one count.
    assert same.all() if signs[1] > 0 else same.mean() > 0.99
    assert np.abs(log.y - expected.y).max() < 1.01 * emulator.plant.count
    assert np.ptp(log.y) > 0.5  # it did move


def test_the_same_seed_gives_the_same_log_whatever_the_line_did(rig, steps):
    logs = [played(rig, steps(), garbled=share, lost=share)[1] for share in (0.0, 0.0, 0.02)]
    assert (logs[0].y == logs[1].y).all()
    came = ~np.isnan(logs[2].y)
    assert 0.8 < came.mean() < 1.0
    assert (logs[2].y[came] == logs[0].y[came]).all()
    assert logs[2].u == pytest.approx(logs[0].u)  # no limit and no slew in between: what was sent is what was played


def test_lost_samples_are_marked_and_told_and_never_filled(rig, steps, tmp_path):
    recording, log, _ = played(rig, steps(), garbled=0.02, lost=0.005)
    lost = np.flatnonzero(np.isnan(log.y))
    assert len(lost) == len(recording.lost) > 3
    assert recording.bad > 0
    assert recording.missing >= len(lost)
    assert f"{len(lost)} of 400 samples were lost on the line" in log.meta["notes"][0]
    assert np.flatnonzero(~log.io().observed[:, 0]).tolist() == lost.tolist()
    read = read_record(log.save(tmp_path / "log.csv"), missing="mark").data
    assert np.flatnonzero(~read.observed[:, 0]).tolist() == lost.tolist()
    for suffix in (".csv", ".parquet", ".mat"):
        again = twin.Log.load(log.save(tmp_path / f"log{suffix}"))
        assert again.meta["filled"] == lost.tolist()
        assert again.meta["rig"] == log.meta["rig"]
        assert again.joint == "shoulder"


def test_a_noisy_line_delays_the_beginning_and_never_the_levels(rig, steps):
    """A tenth of the frames lost, each way: LEVELS are said again, and ARM begins anew."""
    recording, log, _ = played(rig, steps(), garbled=0.05, lost=0.05)
    assert recording.reason == ""
    assert len(log.y) == 400


def test_soft_limits_cut_outwards_and_are_told(rig):
    u = np.repeat([8.0, -8.0, 8.0], 150)
    recording, log, _ = played(rig, u, changes={"soft_low": -0.2, "soft_high": 0.2})
    assert recording.reason == ""
    assert set(np.unique(recording.limits)) == {0, 1, 2}
    assert (log.u[recording.limits == 2] < 8.0).all()
    assert np.abs(log.y).max() < 0.3
    assert "the soft limits cut the motor" in " ".join(log.meta["notes"])
    assert log.u[-1] == 0.0


def test_slew_is_in_the_voltage_that_is_logged(rig):
    """From 0 to 6 V at 100 V/s takes 60 ms: three samples, of which the means lie on the ramp."""
    u = np.repeat([6.0, 0.0], 20)
    _, log, _ = played(rig, u, changes={"slew": 100.0})
    ramp = np.minimum(np.round(100.0 / 12.0 * 1023 * 1e-3) / 1023 * 12.0 * np.arange(1, 61), 6.0)  # each millisecond
    assert log.u[:3] == pytest.approx(ramp.reshape(3, 20).mean(axis=1), abs=0.02)
    assert log.u[4:20] == pytest.approx(6.0, abs=0.01)


def test_rising_pulses_from_rest_are_no_stall_and_a_blocked_joint_is(rig):
    """Pulses of 3.1 to 3.3 V leave the joint at rest, which starts at 3.7 V: 6 s under drive."""
    pulses = np.repeat(np.ravel([(v, 0.0) for v in np.linspace(3.1, 3.3, 6)]), 50)
    with rig(changes={"moves_up": 0.35, "moves_down": 0.3}) as (emulator, link, calibration):
        assert emulator.truth(TS)["breakaway_up"] > 3.6
        levels = check_input(Input(pulses, TS), calibration)
        assert calibration.patience(levels, TS) == pytest.approx(6.0)
        impatient = play(link, calibration.setup(1023), levels, TS)
        assert impatient.fault == wire.STALL
        assert impatient.duration == pytest.approx(2 * 3.0, abs=0.5)  # 3 s of drive, and the rests between
        assert play(link, calibration.setup(1023, calibration.patience(levels, TS)), levels, TS).reason == ""
        full = calibration.levels(np.repeat([12.0, -12.0], 50))
        assert calibration.patience(full, TS) < 0.2


def test_a_design_beyond_the_limits_is_refused_before_anything_moves(rig):
    with rig(changes={"largest": 9.0}) as (emulator, _, calibration):
        before = emulator.plant.position(0)
        for u, Ts, said in (
            (np.r_[np.zeros(20), -9.5], TS, r"reaches -9.5 V at 0.4 s, and the rig's largest input is 9 V"),
            (np.zeros(5), TS, "has 5 samples; the rig plays 10 to 65535"),
            (np.zeros(20), 0.0015, "whole milliseconds from 5 ms on"),
            (np.r_[np.zeros(20), np.nan], TS, "sample 20 is not a number"),
        ):
            with pytest.raises(InputError, match=said):
                check_input(Input(u, Ts, "design.csv"), calibration)
        assert emulator.plant.position(0) == before
        assert emulator.board.state == wire.OFF


def test_an_input_is_read_from_a_design_and_from_a_log(tmp_path):
    t, u = np.arange(50) * 0.05, np.sin(np.arange(50.0))
    table = np.column_stack([t, u, 0.1 * u])
    np.savetxt(tmp_path / "d.csv", table, delimiter=",", header="time [s],u [V],y [rad]", comments="")
    given = read_input(tmp_path / "d.csv")
    assert given.u == pytest.approx(u)
    assert given.Ts == pytest.approx(0.05)
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="time [s],u [A],y [rad]", comments="")
    with pytest.raises(InputError, match=r"a.csv: .*\[V\]"):
        read_input(tmp_path / "a.csv")


def rows(*cells):
    """A table of rows with these cells, from row 2 on."""
    return "\n".join(",".join(map(str, row)) for row in zip(*cells, strict=True))


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("time [s],u [V]\n" + rows(TIMES, ["nan" if k == 7 else 1 for k in range(50)]), r"row 9, .*\(NaN\); an input"),
        ("time [s],u [V]\n" + rows(TIMES, ["" if k == 7 else 1 for k in range(50)]), "row 9, .*empty cell; an input"),
        (
            "time [s],u [V]\n" + rows([t + (t > 0.5) for t in TIMES], LEVELS),
            "its clock pauses or starts again, 2 parts",
        ),
        (
            "time [s],u [V]\n" + rows([t + 0.006 * (t % 0.06) / 0.06 for t in TIMES], LEVELS),
            "its steps of time are 0.0",
        ),
        ("time [s],t2 [s],u [V]\n" + rows(TIMES, [2 * t for t in TIMES], LEVELS), "may each be the clock .* --time"),
        ("time [s],u1 [V],u2 [V]\n" + rows(TIMES, LEVELS, LEVELS), "may each be the input; name one with --input"),
        ("u [V],n\n" + rows(LEVELS, [1] * 50), "give it with --ts SECONDS or name a time column with --time "),
    ],
)
def test_an_input_that_is_not_whole_and_clear_is_refused(tmp_path, table, said):
    (tmp_path / "d.csv").write_text(table + "\n")
    with pytest.raises(InputError, match=said):
        read_input(tmp_path / "d.csv")


@pytest.mark.parametrize(("Ts", "decimals"), [(1 / 30, 3), (1 / 30, 2), (0.0125, 3)])
def test_an_input_with_rounded_times_is_whole(tmp_path, Ts, decimals):
    """Steps of 0.03 and 0.04 s that are those of 1/30 s."""
    times, levels = [f"{k * Ts:.{decimals}f}" for k in range(120)], [1.0, -1.0, 2.0, -2.0] * 30
    (tmp_path / "d.csv").write_text("time [s],u [V]\n" + rows(times, levels) + "\n")
    given = read_input(tmp_path / "d.csv")
    assert given.u == pytest.approx(levels)
    assert given.Ts == pytest.approx(Ts, rel=0.01)


def test_what_is_not_clear_of_an_input_can_be_said(tmp_path):
    (tmp_path / "d.csv").write_text("a [s],b [s],u [V],v [V]\n" + rows(TIMES, [2 * t for t in TIMES], LEVELS, [2] * 50))
    given = read_input(tmp_path / "d.csv", Given(time="b [s]", input="u [V]"))
    assert given.Ts == pytest.approx(0.04)
    assert given.u == pytest.approx(LEVELS)
    (tmp_path / "e.csv").write_text("u [V],n\n" + rows(LEVELS, [1] * 50))
    assert read_input(tmp_path / "e.csv", Given(Ts=0.005)).Ts == 0.005
