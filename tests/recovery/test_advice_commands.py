"""Advice names calls and commands that exist, with the record's own numbers, and is silent where nothing is wrong."""

import ast
import inspect
import itertools
import json
import re
import shlex

import numpy as np
import pytest
from often import FULL, often
from scipy.signal import lfilter
from typer.main import get_command

import sysid
from sysid import IOData
from sysid.diagnosis.advice import Advice, advise
from sysid.diagnosis.relation import _computed
from sysid.excitations import Prbs
from sysid.model.recipes import Several
from sysid.structures import TABLE as STRUCTURES
from sysid.structures import OutputError
from sysid.workflow.advice_after_fit import advice_after_fit
from twin.cli import main
from twin.cli.app import build

TS = 0.1


def white(seed: int, n: int = 1500) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=n)


def held(seed: int, n: int = 1500, hold: int = 12) -> np.ndarray:
    return np.repeat(np.random.default_rng(seed).uniform(-1, 1, -(-n // hold)), hold)[:n]


def stopped(seed: int, n: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """An integrator between two stops under held levels."""
    u, x, y = 8.0 * held(seed, n, 40), 0.0, np.zeros(n)
    for t in range(n - 1):
        x = min(max(x + 0.01 * u[t], -0.6), 0.6)
        y[t + 1] = x
    return u, y + 1e-3 * white(seed + 1, n)


def records() -> dict[str, IOData]:
    """A record for every advice."""
    n, u = 1500, held(1)
    lag = lfilter([0, 0.3], [1, -0.7], u)
    noise = 0.01 * white(2)
    step = np.round(lag / 0.1) * 0.1
    spiked = lag + noise
    spiked[[300, 700]] += 3.0
    loop, y = np.zeros(n), np.zeros(n)
    for t in range(1, n):
        y[t] = 0.9 * y[t - 1] + 0.2 * loop[t - 1] + 0.3 * white(3)[t]
        loop[t] = white(4)[t] - 0.8 * y[t]
    long = np.repeat(white(5, 40), 250)
    ramp = np.linspace(0.0, 1.0, 400)
    size = white(8)
    return {
        "binary": IOData(np.sign(u), lfilter([0, 0.3], [1, -0.7], np.sign(u)) + noise, TS),
        "sound": IOData(u, lag + noise, TS),
        "sine": IOData(
            np.sin(0.3 * np.arange(n)), lfilter([0, 0.3], [1, -0.7], np.sin(0.3 * np.arange(n))) + noise, TS
        ),
        "coarse": IOData(u, step, TS),
        "spiked": IOData(u, spiked, TS),
        "drifting": IOData(u, lag + noise + np.linspace(0, 1, n), TS),
        "loop": IOData(loop, y, TS),
        "bent": IOData(u, lag**2 + lag + noise, TS),
        "direct": IOData(white(6), 0.7 * white(6) + noise, TS),
        "unrelated": IOData(white(6), white(7), TS),
        "size": IOData(size, lfilter([0, 0.3], [1, -0.7], np.abs(size) ** 1.5) + noise, TS),
        "ramp": IOData(-(ramp**2) + 0.02 * white(9, 400), -np.maximum.accumulate(ramp**2), TS),
        "fast": IOData(white(10), lfilter([0, 1.0], [1, -0.1], white(10)) + noise, TS),
        "crowded": IOData(long, lfilter([0, 0.005], [1, -0.995], long) + 1e-4 * white(11, 10000), 0.001),
        "integrating": IOData(white(12), np.cumsum(white(12)) + noise, TS),
        "stopped": IOData(*stopped(13), TS),
        "short": IOData(white(14, 40), white(15, 40), TS),
    }


@pytest.fixture(scope="module")
def told() -> dict[str, tuple[Advice, ...]]:
    return {name: advise(data) for name, data in records().items()}


def resolved(node: ast.AST):
    """The object that a dotted name of sysid or numpy names; AttributeError if there is none."""
    if isinstance(node, ast.Attribute):
        return getattr(resolved(node.value), node.attr)
    assert isinstance(node, ast.Name)
    return {"sysid": sysid, "np": np}[node.id]


def bind(call: ast.Call) -> None:
    """Raises TypeError for arguments that the function does not take."""
    function = call.func
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Call):  # a method of what a call gives
        bind(function.value)
        inner = resolved(function.value.func)
        kind = inner if inspect.isclass(inner) else getattr(inner, "__self__", inner)
        target, first = getattr(kind, function.attr), (None,)
    else:
        target, first = resolved(function), ()
    inspect.signature(target).bind(*first, *call.args, **{k.arg: k.value for k in call.keywords})
    for argument in (*call.args, *(k.value for k in call.keywords)):
        if isinstance(argument, ast.Call):
            bind(argument)


def check_call(text: str) -> None:
    node = ast.parse(text, mode="eval").body
    while isinstance(node, ast.Attribute):
        node = node.value
    assert isinstance(node, ast.Call), text
    bind(node)


def check_command(words: list[str]) -> None:
    """Typer's own parser takes them; a structure must exist, which it does not check."""
    program, verb, *arguments = words
    assert program == "qpal"
    command = get_command(build()).commands[verb]
    context = command.make_context(verb, list(arguments), resilient_parsing=False)
    structure = context.params.get("structure")
    assert structure is None or structure == "auto" or structure in sysid.structures.TABLE
    if "--orders" in words:
        assert context.params["orders"]


def test_every_call_and_command_of_the_advice_exists(told):
    seen = set()
    for found in told.values():
        for a in found:
            for name in re.findall(r"sysid(?:\.\w+)+", f"{a.sentence} {a.action}"):
                resolved(ast.parse(name, mode="eval").body)
            if a.call:
                check_call(a.call)
            if a.command:
                check_command(["qpal", a.command[0], "my log.csv", "--ts", "0.1", *a.command[1:]])
                assert (
                    shlex.join(["qpal", a.command[0], "my log.csv", "--ts", "0.1"])
                    in a.of_file("my log.csv", ("--ts", "0.1")).action
                )
            if a.severity == "warning" and a.topic not in ("data", "rate", "resolution"):
                assert a.call, a
            seen.add((a.topic, a.severity))
    wanted = {("data", "warning"), ("excitation", "warning"), ("levels", "note"), ("delay", "warning")}
    wanted |= {("delay", "note"), ("feedback", "warning"), ("nonlinearity", "note"), ("rate", "warning")}
    wanted |= {("rate", "note"), ("rest", "note"), ("resolution", "warning"), ("outliers", "warning")}
    assert (wanted | {("drift", "warning")}) - seen == set()


def test_a_call_does_what_the_advice_says():
    """The calls that change or make a record, run."""
    made = records()
    names = {"sysid": sysid, "np": np}
    calls = {
        a.topic: (a.call, made[name])
        for name in ("sine", "spiked", "drifting", "crowded")
        for a in advise(made[name])
        if a.severity != "fine" and a.topic in ("excitation", "outliers", "drift", "rate") and a.call
    }
    assert set(calls) == {"excitation", "outliers", "drift", "rate"}
    done = {topic: eval(call, {**names, "data": data}) for topic, (call, data) in calls.items()}
    before, u = calls["excitation"][1], done["excitation"]
    assert (len(u), u.min() >= before.u.min(), u.max() <= before.u.max()) == (before.N, True, True)
    assert len(np.unique(u)) > 30
    assert set(np.flatnonzero(done["outliers"].missing[:, 0])) == {300, 700}
    assert all(a.severity == "fine" for a in advise(done["drift"]) if a.topic == "drift")
    assert done["rate"].Ts > 2 * calls["rate"][1].Ts


@pytest.mark.parametrize("verb", ["identify", "info"])
def test_end_stops_name_the_joint_with_this_record_in_the_command(verb, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    u, y = stopped(3)
    np.savetxt("my log.csv", np.column_stack([u, 0 * u + 0.5, y]), delimiter=",", header="drive,idle,out", comments="")
    given = ["my log.csv", "--input", "drive", "--output", "out", "--ts", "0.1"]
    model = ["--structure", "output_error", "--orders", "1,1,1", "--starts", "1"] if verb == "identify" else []
    assert main([verb, *given, *model, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    (rest,) = (a for a in summary["advice"] if a["topic"] == "rest")
    assert rest["severity"] == "note"
    words = shlex.split(rest["action"].partition("saturates: ")[2])
    assert words == ["qpal", "identify", *given, "--structure", "actuated_joint"]


def test_no_advice_speaks_of_an_input_map_that_the_model_does_not_have(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    u = np.where(held(4) > 0, 1.0, -1.0)
    np.savetxt("log.csv", np.column_stack([u, lfilter([0, 0.3], [1, -0.7], u) + 0.01 * white(5)]), delimiter=",")
    assert main(["identify", "log.csv", "--ts", "0.1", "--structure", "output_error", "--orders", "1,1,1"]) == 0
    assert "break points" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("named", "fitted", "percent", "kept"),
    [
        ("hammerstein_wiener", "hammerstein_wiener", 30.0, False),  # it has just failed
        ("hammerstein_wiener", "actuated_joint", 98.5, False),  # less than what fits
        ("hammerstein_wiener", "actuated_joint", 30.0, True),
        ("hammerstein_wiener", "output_error", 85.0, True),
        ("actuated_joint", "hammerstein_wiener", 98.0, True),
        ("output_error", "output_error", 98.0, False),
        ("output_error", "wiener", 98.0, False),
    ],
)
def test_after_a_fit_no_advice_names_it_or_less(named, fitted, percent, kept):
    said = Advice("nonlinearity", "found", 0.0, "do it", "note", call="f()", command=("identify", "--structure", named))
    found = advice_after_fit(said, STRUCTURES[fitted](), percent)
    assert found.sentence == "found"
    assert (found == said) == kept
    assert kept or not (found.action or found.call or found.command)


@pytest.mark.parametrize(
    ("fitted", "delay", "orders"),
    [
        (OutputError(1, 1, 1), 1, None),
        (OutputError(1, 1, 1), 4, "1,1,4"),
        (OutputError(3, 2, 0), 2, None),
        (OutputError(3, 2, 0), 3, "3,2,3"),
        (STRUCTURES["actuated_joint"](), 3, None),
    ],
)
def test_a_delay_names_the_fitted_orders_and_only_where_they_cannot_hold_it(fitted, delay, orders):
    said = Advice("delay", "found", delay, "use it", "fine", call="f()", command=("identify", "--structure", "other"))
    found = advice_after_fit(said, fitted, 98.0)
    assert found.sentence == "found"
    assert found.action == ("use it" if orders else "")
    assert found.command == (("identify", "--structure", fitted.name, "--orders", orders) if orders else ())
    assert not found.call


# --- false alarms


def test_an_output_that_settles_at_the_levels_of_its_input_meets_no_end_stop():
    """A lag under a slow binary input rests at both extremes for most of the time."""
    alarms = 0
    for seed in often(30, 10):
        u = Prbs(1.0, 10, 40.0).generate(1500, 1.0, np.random.default_rng(seed))
        y = lfilter([0, 0.3], [1, -0.7], u) + 0.01 * white(seed + 100)
        (rest,) = (a for a in advise(IOData(u, y, 1.0)) if a.topic == "rest")
        assert rest.value > 0.2
        alarms += rest.severity != "fine"
    assert alarms <= (2 if FULL else 1)
    (rest,) = (a for a in advise(IOData(*stopped(13), TS)) if a.topic == "rest")
    assert rest.severity == "note"


def test_end_stops_stay_end_stops_where_no_nonlinearity_is_significant():
    """One step ahead a linear model predicts a rest; its free run does not follow it."""
    found = [{a.topic: a for a in advise(IOData(*stopped(seed, 300), TS))} for seed in range(12)]
    found = [said for said in found if said["nonlinearity"].severity == "fine"]
    assert len(found) > 3
    for said in found:
        assert said["rest"].severity == "note"
        assert "end stop" in said["rest"].sentence
        assert not said["nonlinearity"].action
        assert not said["nonlinearity"].command


@pytest.mark.parametrize("seed", [1, 3, 4, 6, 7])
def test_the_speed_of_a_joint_names_the_joint_as_its_angle_does(seed):
    u, y = stopped(seed)
    speed = np.gradient(y, TS)
    angle, moved = (advise(IOData(u, x, TS, y_unit=unit)) for x, unit in ((y, "deg"), (speed, "deg/s")))
    said, found = ([a for a in each if a.topic == "rest" and a.severity == "note"] for each in (angle, moved))
    assert found[-1].command == said[0].command == ("identify", "--structure", "actuated_joint")
    assert "is zero in" in found[-1].sentence
    at_end = np.mean((np.abs(speed) < 0.05 * np.ptp(speed)) & (np.abs(u) > 0.5 * np.abs(u).max()))
    assert found[-1].value == pytest.approx(at_end, abs=0.05)


@pytest.mark.parametrize("lag", [3.0, 30.0, 100.0])
def test_the_speed_of_a_motor_without_stops_names_none(lag):
    """A slow one is near zero for 13 % of the time, after each change of sign: a linear model follows it."""
    alarms = 0
    for seed in range(10):
        u = Prbs(12.0, 12, 25 * TS).generate(1500, TS, np.random.default_rng(seed))
        y = lfilter([0, 1 - np.exp(-1 / lag)], [1, -np.exp(-1 / lag)], u) + 0.02 * white(seed + 100)
        alarms += any("is zero in" in a.sentence for a in advise(IOData(u, y, TS, y_unit="rad/s")))
    assert alarms <= 1


def test_the_flicker_of_a_converter_and_a_trace_of_drift_are_nothing_to_mend(told):
    u = held(20)
    y = np.round(lfilter([0, 0.3], [1, -0.7], u), 2)
    y[np.arange(1400, 1500)] = y[1399]
    y[1450] += 0.002
    assert next(a for a in advise(IOData(u, y, TS)) if a.topic == "outliers").severity == "fine"
    slow = lfilter([0, 0.3], [1, -0.7], u) + 1e-5 * white(21) + 0.005 * np.linspace(0, 1, 1500)
    assert next(a for a in advise(IOData(u, slow, TS)) if a.topic == "drift").severity == "fine"


def test_columns_that_belong_together_are_not_suspected(told):
    for name, said in (("size", "but a nonlinear one"), ("ramp", "move together")):
        (found,) = (a for a in told[name] if a.topic == "delay")
        assert said in found.sentence
    (found,) = (a for a in told["unrelated"] if a.topic == "delay")
    assert "belong together" in found.action


def test_the_structures_that_calls_name_are_built(told):
    """A chain takes limits by name, so that a call with a wrong order binds and is refused only then."""
    data = IOData(white(1), white(2), TS)
    for a in (_computed("u", "y", data), *itertools.chain(*told.values())):
        if a.call.startswith("sysid.fit(sysid.structures"):
            eval(a.call.removeprefix("sysid.fit(").removesuffix(", data)"), {"sysid": sysid})
    two = _computed("u1", "y", IOData(np.column_stack([white(1), white(3)]), white(2), TS))
    assert (two.call, two.command) == ("", ())


def test_what_is_advised_for_two_inputs_is_fitted_to_them(tmp_path):
    """A loop on the first input, a bent effect alone of the second: neither call nor command is refused."""
    loop, y, size = np.zeros(800), np.zeros(800), white(8, 800)
    noise, other = white(3, 800), white(4, 800)
    for t in range(1, 800):
        y[t] = 0.9 * y[t - 1] + 0.2 * loop[t - 1] + 0.3 * noise[t] + 0.6 * (np.abs(size[t - 1]) ** 1.5 - 0.8)
        loop[t] = other[t] - 0.8 * y[t]
    data = IOData(np.column_stack([loop, size]), y, TS)
    found = [a for a in advise(data) if a.severity != "fine"]
    assert {"feedback", "delay"} <= {a.topic for a in found}
    for a in found:
        if "--structure" in a.command:
            recipe = STRUCTURES[a.command[a.command.index("--structure") + 1]]()
            assert isinstance(recipe, Several), a
        if a.call.startswith("sysid.fit"):
            model = eval(a.call.removeprefix("sysid.fit(").removesuffix(", data)"), {"sysid": sysid})
            assert model.channels == (2, 1), a
        assert "armax" not in a.call + a.action
