"""What is known after some experiments, each of which tells some values."""

import json
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from sysid.base.errors import InputError
from sysid.joint.values import JointValue
from twin.cli import main
from twin.report import rig as report
from twin.rig.auto import ASKED, Campaign, Round, campaign, led_by_each_other
from twin.rig.journal import journal
from twin.studies.beyond import link_crosses


def value(name, low, high):
    """A stand-in of a joint's value, with its interval or without one."""
    return SimpleNamespace(name=name, low=low, high=high, determined=low is not None)


def test_a_value_is_that_of_the_record_that_tells_it_most_narrowly():
    first, second = ASKED[:2]
    rounds = [
        Round("sweep", None, (value(first, 1.0, 2.0), value(second, None, None), value("other", 0.0, 1.0)), 90.0),
        Round("design", None, (value(first, 0.0, 4.0), value(second, 3.0, 4.0)), 90.0),
    ]
    campaign = Campaign("thigh", tuple(rounds), 100.0)
    assert campaign.values_after(1)[first].high == 2.0
    known = campaign.values_after(2)
    assert (known[first].high, known[second].high) == (2.0, 4.0)
    assert "other" not in known
    assert campaign.open == list(ASKED[2:])


def test_the_report_has_every_picture_in_less_than_1500_kb():
    """Three experiments of two minutes and more, and all values; without the 5 MB that draw a figure anew."""
    rng = np.random.default_rng(0)
    log = twin.Log(np.zeros(7000), np.cumsum(rng.normal(size=7000)), 0.02, None, "thigh", {"notes": []})
    values = tuple(JointValue(name, 1.0, 0.9, 1.1, "rad") for name in ASKED)
    rounds = tuple(Round(f"sweep {k}", log, values, 90.0) for k in range(3))
    page = report.page(Campaign("thigh", rounds, 400.0))
    names = [picture.name for picture in page.pictures()]
    assert names == ["intervals", "record-1", "record-2", "record-3"]
    html = page.html()
    assert html.count("data:image/png;base64,") == 4
    assert len(html) < 1_500_000


def test_an_experiment_that_is_stopped_ends_the_campaign_and_its_journal_stays_until_its_log(rig, tmp_path):
    """`around` is the context of the run and of the log."""
    seen, kept = [], []
    with rig() as (_, link, calibration):

        @contextmanager
        def around(number, given, levels):
            with journal(tmp_path / "o.csv", link, calibration, levels, given.Ts, given.source) as note:

                def watch(sample):
                    note(sample)
                    if sample.number == 300 and len(sample.joints) == 1:
                        link.stop()

                link.watch = watch
                yield
                link.watch = lambda sample: None

        def keep(number, log):
            seen.append((tmp_path / "o.csv.journal").exists())
            kept.append(log)

        result = campaign(link, calibration, keep=keep, around=around)
    assert result.interrupted
    assert result.rounds == ()
    assert result.stopped == "experiment 1 ended early: it was stopped by hand"
    assert seen == [True]
    assert 300 < kept[0].N < 500
    assert list(tmp_path.iterdir()) == []


def test_no_experiment_goes_beyond_the_rig_time_also_with_the_way_to_where_it_begins(rig, monkeypatch):
    """Pieces of a second that drive the joint to and fro, as many as fit, for a joint of which nothing is known."""
    Ts, names = 0.02, [f"part {k}" for k in range(600)]
    u = np.repeat([6.0, -6.0] * 300, 50)
    phases = [SimpleNamespace(name=name, start=50 * k, stop=50 * (k + 1)) for k, name in enumerate(names)]
    fit = SimpleNamespace(fit_percent=lambda data: 90.0)
    monkeypatch.setattr("twin.rig.auto.fit_joint", lambda *_, **__: SimpleNamespace(fit=fit))
    monkeypatch.setattr("twin.rig.auto.searched_from", lambda fit, others, data: fit)
    monkeypatch.setattr("twin.rig.auto.joint_values", lambda *_, **__: ())
    monkeypatch.setattr("twin.rig.auto.design", lambda *_, **__: SimpleNamespace(u=u, Ts=Ts, phases=phases))
    with rig() as (_, link, calibration):
        budget = link.rig_seconds + 125.0 + 60.0
        result = campaign(link, calibration, budget=budget)
    assert len(result.rounds) == 3
    assert budget - 10.0 < result.rig_seconds <= budget


def test_where_the_found_joint_does_not_move_a_sweep_is_played_again(rig, monkeypatch):
    """A first record may lead to a joint that starts beyond the supply; the joint on the rig is not that one."""

    def refused(*_, **__):
        raise InputError("the joint starts at 17 V and the input may not exceed 12")

    fit, heard = SimpleNamespace(fit_percent=lambda data: 90.0), []
    monkeypatch.setattr("twin.rig.auto.fit_joint", lambda *_, **__: SimpleNamespace(fit=fit))
    monkeypatch.setattr("twin.rig.auto.searched_from", lambda fit, others, data: fit)
    monkeypatch.setattr("twin.rig.auto.joint_values", lambda *_, **__: ())
    monkeypatch.setattr("twin.rig.auto.design", refused)
    with rig() as (_, link, calibration):
        result = campaign(link, calibration, step=heard.append)
    assert [done.what for done in result.rounds] == ["first sweep", "sweep 2", "sweep 3"]
    assert sum("would not move; a sweep again" in said for said in heard) == 2
    assert not np.array_equal(result.rounds[0].log.u, result.rounds[1].log.u)


def test_each_record_is_searched_from_where_the_others_lead(monkeypatch):
    asked, log = [], SimpleNamespace(io=lambda: None)
    first, second, better = (SimpleNamespace(name=n, fit_percent=lambda _: 95.0) for n in ("first", "second", "better"))

    def searched(fit, others, data):
        asked.append((fit.name, [other.name for other in others]))
        return better if fit is first else fit

    monkeypatch.setattr("twin.rig.auto.searched_from", searched)
    monkeypatch.setattr("twin.rig.auto.joint_values", lambda fit, **_: (value(fit.name, 1.0, 2.0),))
    rounds = (Round("sweep", log, (), 80.0, first), Round("design", log, (), 90.0, second))
    led = led_by_each_other(rounds, 0.0)
    assert asked == [("second", ["first"]), ("first", ["second"])]
    assert led[1] is rounds[1]
    assert (led[0].what, led[0].values[0].name, led[0].fit_percent, led[0].fit) == ("sweep", "better", 95.0, better)


def test_the_weight_of_the_thigh_alone_keeps_its_link_on_one_side_of_the_backlash():
    assert not link_crosses("thigh")
    assert link_crosses("shank")


@pytest.mark.parametrize("as_json", [False, True])
def test_auto_that_is_stopped_says_where_its_logs_are(tmp_path, monkeypatch, capsys, as_json):
    """Ctrl-C while it identifies: exit status 130, and the log of the experiment before."""
    monkeypatch.chdir(tmp_path)

    def fit(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("twin.rig.auto.fit_joint", fit)
    arguments = ["rig", "auto", "shoulder", "--emulate", "twin", "--seed", "1", "--yes", "--out", "o"]
    assert main([*arguments, *(["--json"] if as_json else [])]) == 130
    out, err = capsys.readouterr()
    assert "qpal: stopped; the drive is off; the logs are in o-logs" in err
    assert twin.Log.load("o-logs/experiment-1.csv").N > 1000
    assert sorted(str(path) for path in Path().iterdir()) == ["o-logs"]
    logs = [str(Path("o-logs/experiment-1.csv"))]
    assert (json.loads(out) if as_json else out) == ({"stopped": True, "logs": logs} if as_json else "")
