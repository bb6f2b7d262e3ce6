"""A servo on an emulated bus goes round until its values are determined."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dynamixel_sdk", reason="servo buses need dynamixel-sdk: pip install 'qpal[dynamixel]'")
pytest.importorskip("scservo_sdk", reason="servo buses need ftservo-python-sdk: pip install 'qpal[feetech]'")

from twin.cli import main
from twin.log import Log
from twin.rig.bus.auto import KINDS, TS, campaign, goals_of
from twin.rig.bus.emulator import Emulator
from twin.rig.bus.registers import DYNAMIXEL
from twin.rig.bus.servo import wired

LOW, HIGH = -0.4, 0.9


def campaign_of(seed, **options):
    """A campaign on the emulated servo `seed`, and the servo's hidden values."""
    with Emulator(DYNAMIXEL, seed, garbled=0.01) as emulator, emulator.bus() as bus:
        servo = wired(bus, 1, "thigh", lambda sentence: None)[0]
        return campaign(bus, servo, seed, **options), emulator.truth()


@pytest.mark.parametrize("kind", KINDS)
def test_goals_stay_between_the_limits_and_move_as_their_name_says(kind):
    u = goals_of(kind, LOW, HIGH, np.random.default_rng(3))
    changes = np.abs(np.diff(u))
    assert len(u) * TS == pytest.approx(40.0)
    assert LOW <= u.min() < u.max() <= HIGH
    moves = changes[changes > 0.0]
    share, size = len(moves) / len(changes), np.median(moves) / (HIGH - LOW)
    wanted = {
        "steps": (0.03, 0.3),
        "small steps": (0.03, 0.03),
        "slow ramps": (0.99, 0.004),
        "fast reversals": (0.13, 0.2),
    }
    assert (share, size) == (pytest.approx(wanted[kind][0], rel=0.5), pytest.approx(wanted[kind][1], rel=0.5))


def test_the_first_goals_tell_speed_and_time_constant_and_the_folder_has_the_log(tmp_path, monkeypatch, capsys):
    """On a joint that another file is of, nothing moves."""
    monkeypatch.chdir(tmp_path)
    rig = ("--emulate", "dynamixel", "--seed", "308", "--yes")
    assert main(["rig", "auto", "thigh", *rig, "--experiments", "1", "--out", "o"]) in (0, 1)
    told = json.loads(Path("o/summary.json").read_text())
    values = {v["name"]: v for v in told["values"]}
    for name in ("speed_full_drive", "lag_and_delay"):
        assert values[name]["low"] <= told["truth"][name] <= values[name]["high"]
    log = Log.load("o/experiment-1.csv")
    assert (log.mode, log.N) == ("servo", 2000)
    assert "intervals hold the truth" in capsys.readouterr().out
    assert main(["rig", "wire", "shank", *rig[:4]]) == 0
    assert main(["rig", "auto", "thigh", *rig]) == 2
    assert "rig.toml is of the shank, a dynamixel servo" in capsys.readouterr().err
    assert main(["rig", "wire", "thigh", *rig[:4]]) == 2  # another joint's file is not written over
    assert "rig.toml is that of the shank, a dynamixel servo; give another --rig" in capsys.readouterr().err
    assert main(["rig", "auto", "thigh", *rig, "--rig", "none.toml"]) == 2
    assert "none.toml" in capsys.readouterr().err
    Path("rig.toml").write_text('joint = "thigh"\nchannel = 1\n')
    assert main(["rig", "auto", "thigh", *rig]) == 2
    assert "rig.toml is that of a board, not of a servo" in capsys.readouterr().err


def test_a_run_that_is_stopped_leaves_its_log_and_says_so():
    kept = []

    def share(part):
        if part > 0.3:
            raise KeyboardInterrupt

    done, _ = campaign_of(1, share=share, keep=lambda number, log, recording: kept.append(log.N))
    assert done.interrupted
    assert done.rounds == ()
    assert done.stopped == "experiment 1 ended early: it was stopped by hand"
    assert 500 < kept[0] < 800


@pytest.mark.nightly
def test_slow_ramps_tell_the_friction_that_steps_leave_open():
    """What the first record's words advise is what the next experiment does."""
    done, true = campaign_of(1)
    first = {v.name: v for v in done.rounds[0].values}
    assert not first["coulomb_up"].determined
    assert "record slow ramps of the goal as well" in first["coulomb_up"].why
    assert [each.what for each in done.rounds][-1] == "slow ramps"
    assert done.open == []
    known = done.values_after(3)
    assert all(known[name].holds(true[name]) for name in ("speed_full_drive", "lag_and_delay"))
    assert done.rig_seconds < 150.0
