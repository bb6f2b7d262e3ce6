"""`qpal compare`, `qpal simulate --input-log` and `qpal view --compare`: what they write, and what they refuse."""

import json
import shlex

import numpy as np
import pytest
from cases import LOGS

import sysid
import twin
from twin.cli import main
from twin.compare.search import Trials
from twin.log import Log
from twin.view.traces import Traces, panel

P = twin.Parameters()


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    """A log of the shoulder that comes 60 ms later than the twin's."""
    given = Log.load(LOGS / "one.csv")
    given = Log(given.u, np.zeros(given.N), given.Ts, joint="shoulder")
    (row,) = Trials(twin.Follower(given, "shoulder"), P).rows([{"delay": 0.06}])
    y = row + np.deg2rad(0.1) * np.random.default_rng(0).standard_normal(len(row))
    path = tmp_path_factory.mktemp("logs") / "a late log.parquet"
    return Log(given.u, y, given.Ts, joint="shoulder").save(path)


def test_a_late_log_is_said_to_be_late(late, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["compare", str(late), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["verdict"]["first"] == "delay"
    assert "Delay explains" in said
    step = f"qpal calibrate '{late}' --joint shoulder --free delay"
    assert f"Next: {step}" in said
    assert main([*shlex.split(step)[1:], "--seconds", "1", "--out", str(tmp_path / "next")]) in (0, 1)
    assert (tmp_path / "next" / "shoulder.toml").exists()
    delay = summary["alignment"]["delay"]
    assert 0.0 < delay["low"] < 0.06 < delay["high"]
    assert summary["alignment"]["applied"] == []
    assert sum(regime["share"] for regime in summary["regimes"]) == pytest.approx(1.0)
    values = {row["name"]: row for row in summary["joint_values"]}
    # Delay and lag are correlated by 0.85 to 0.9 here, on the edge of being told apart; their sum is told either way.
    sums = [values[name] for name in ("time_constant", "delay", "lag_and_delay") if name in values]
    later = sum(row["log"]["value"] - row["other"]["value"] for row in sums)
    assert later == pytest.approx(0.06, abs=0.02)
    html = (out / "report.html").read_text(encoding="utf-8")
    for title in ("Physical effects", "Alignment", "Frequency response", "Residual tests"):
        assert f"{title}</h2>" in html


def test_a_saved_model_stands_beside_the_log(tmp_path, capsys):
    data = Log.load(LOGS / "one.csv").io()
    fit = sysid.fit(sysid.structures.output_error(2, 2, 1), data)
    fit.save(tmp_path / "model.json")
    given = ["compare", str(LOGS / "one.csv"), "--joint", "shoulder", "--against", str(tmp_path / "model.json")]
    assert main([*given, "--json", "--out", str(tmp_path / "out")]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["kind"], summary["against"]) == ("model", "model.json")
    assert summary["fit"] == pytest.approx(fit.fit_percent(data), abs=1e-6)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ([], "does not name one joint; give --joint"),
        (["--joint", "knee"], "unknown joint 'knee'"),
        (["--joint", "shoulder", "--align", "phase"], "unknown part of an alignment 'phase'"),
        (["--joint", "shoulder", "--seconds", "0"], "--seconds is 0; give a positive"),
        (["--joint", "shoulder", "--against", "nowhere.csv"], "nowhere.csv"),
        (["--joint", "shoulder", "--against", "nowhere.json"], "cannot read nowhere.json"),
        (["--joint", "shoulder", "--against", "x.csv", "--align", "delay"], "--align belongs to the twin"),
        (["--joint", "shoulder", "--against", "x.csv", "--pot-side", "link"], "--pot-side belongs to the twin"),
    ],
)
def test_what_cannot_be_compared_is_said_in_one_line(given, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["compare", str(LOGS / "one.csv"), *given]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_joint_that_the_log_contradicts_is_refused(late, capsys):
    assert main(["compare", str(late), "--joint", "shank"]) == 2
    assert "is a log of the shoulder and --joint is shank" in capsys.readouterr().err


def test_simulate_under_the_input_of_a_log(tmp_path, capsys):
    """Same input and sampling time, from its first angle, with the noise of the seed; as the follower records it."""
    source, target = LOGS / "one.csv", tmp_path / "twin.parquet"
    given = ["simulate", "--input-log", str(source), "--joint", "shoulder", "--seed", "5", "--log", str(target)]
    assert main([*given, "--out", str(tmp_path / "out"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    log, back = Log.load(source), Log.load(target)
    np.testing.assert_array_equal(back.u, log.u)
    assert (back.Ts, back.N, back.joint) == (log.Ts, log.N, "shoulder")
    assert summary["log"]["start"] == pytest.approx(log.y[0])
    direct = twin.Follower(log, "shoulder").record(P, seed=5)
    np.testing.assert_array_equal(back.y, direct.y)
    assert 0.5 < np.std(back.y - back.y_true) / P["pot_noise"] < 2.0


@pytest.mark.parametrize("option", [["--duration", "5"], ["--excitation", "aprbs"], ["--ts", "0.1"], ["--set", "a=1"]])
def test_what_an_input_log_fixes_is_refused(option, capsys):
    given = ["simulate", "--input-log", str(LOGS / "one.csv"), "--joint", "shoulder"]
    assert main([*given, *option]) == 2
    said = capsys.readouterr().err
    assert f"{option[0]} is given with --input-log" in said
    assert main([*given, "--mode", "servo"]) == 2
    assert "is a log in voltage mode" in capsys.readouterr().err
    assert main(["simulate", "--input-log", str(LOGS / "one.csv"), "--joint", "leg"]) == 2
    assert "a log drives one joint" in capsys.readouterr().err


def test_mcap_holds_every_sample_of_log_and_twin(late, tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="mcap is in the robot extra")
    path = tmp_path / "both.mcap"
    assert main(["view", str(late), "--mcap", str(path)]) == 0
    log, found = Log.load(late), {}
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            value = json.loads(message.data)
            assert set(value) == set(json.loads(schema.data)["required"])
            found.setdefault(channel.topic, []).append((message.log_time * 1e-9, value["value"], value["unit"]))
    assert set(found) == {"/input", "/log/shoulder", "/twin/shoulder", "/error/shoulder"}
    times, angles, units = zip(*found["/log/shoulder"], strict=True)
    np.testing.assert_allclose(times, log.t, atol=1e-9)
    np.testing.assert_array_equal(angles, log.y)
    assert set(units) == {"rad"}
    np.testing.assert_array_equal([value for _, value, _ in found["/input"]], log.u)
    both = [np.array([value for _, value, _ in found[f"/{name}/shoulder"]]) for name in ("log", "twin", "error")]
    np.testing.assert_allclose(both[0] - both[1], both[2], atol=1e-15)
    assert np.std(both[2][5:]) > np.deg2rad(1.0)  # 60 ms of a fast joint


def test_mcap_without_its_library_is_said(late, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "mcap.writer", None)
    assert main(["view", str(late), "--mcap", str(tmp_path / "both.mcap")]) == 2
    assert "pip install 'qpal[robot]'" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--compare"], "--compare is given without a LOG"),
        ([str(LOGS / "one.csv"), "--compare"], "--compare needs one joint"),
        ([str(LOGS / "one.csv"), "--compare", "--ghost", "x.csv"], "there is one ghost"),
        ([str(LOGS / "one.csv"), "--joint", "shoulder", "--mcap", "a.txt"], "a name that ends in .mcap"),
        (["--params", "a.toml"], "--params is given without --compare"),
    ],
)
def test_what_cannot_be_shown_beside_the_twin_is_said(given, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["view", *given]) == 2
    assert says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_panel_under_a_frame_shows_its_time():
    """The line stands at the left edge of the axes at the start, at the right edge at the end."""
    from PIL import Image

    t = np.arange(100) * 0.1
    traces = Traces("thigh", t, np.sin(t), 0.1 * t, 0.09 * t)
    made = panel(traces, 2.0, 6.0, 640)
    image = Image.new("RGB", (640, 480), "white")
    columns = []
    for time in (2.0, 4.0, 6.0):
        whole = np.asarray(made.paste_below(image, time)).astype(int)
        assert whole.shape == (480 + made.picture.shape[0], 640, 3)
        changed = np.abs(whole[480:] - made.picture).sum(axis=2)
        columns.append(float(np.flatnonzero(changed.sum(axis=0) > 0).mean()))
    assert columns[1] == pytest.approx((columns[0] + columns[2]) / 2, abs=1.0)
    assert columns[0] == pytest.approx(made.left, abs=1.5)
    assert columns[2] == pytest.approx(made.right, abs=1.5)
