"""The page for authors of methods: its change of the scaffold removes the bias that it speaks of, its commands run."""

import re
import shlex
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from sysid.bench.contract import Data
from sysid.bench.method_file import add, load
from sysid.bench.table import read
from sysid.bench.task import Task
from sysid.data.record import IOData
from twin.cli import main

PAGE = (Path(__file__).parents[2] / "docs" / "benchmark-method.md").read_text(encoding="utf-8")
(CHANGE,) = re.findall(r"^```python\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)
COMMANDS = re.findall(r"^qpal (bench .*?)(?: +#.*)?$", PAGE, flags=re.MULTILINE)
POLES = np.array([0.75 - 0.37j, 0.75 + 0.37j])


def noisy(rng: np.random.Generator) -> Task:
    """A linear plant whose output carries 20 % of white noise."""
    u, v = rng.standard_normal((2, 3000))
    f = np.poly(POLES).real
    y, z = (lfilter([0.0, 0.5, 0.3], f, x) for x in (u, v))
    train = IOData(u, y + 0.2 * y.std() * rng.standard_normal(len(y)), 0.1)
    return Task(train, {"test": IOData(v, z, 0.1)}, 20, orders=(2, 2, 1))


def error(method, task: Task) -> float:
    """Distance of the poles from the true ones."""
    tests = {name: (t.u[:, 0], t.y[: task.drop, 0]) for name, t in task.tests.items()}
    outcome = method.solve(task, tests, 30.0, 0)
    assert outcome.status == "ok"
    poles = np.sort_complex([complex(*z) for z in outcome.details["poles"]])
    return float(np.abs(poles - POLES).max())


def test_the_change_of_the_page_removes_the_bias(tmp_path):
    path = add("my_arx", tmp_path)
    task = noisy(np.random.default_rng(0))
    before = error(load(path), task)
    text = path.read_text(encoding="utf-8")
    head, _, rest = text.partition("def fit(data):")
    path.write_text(head + CHANGE + "\n\n" + rest[rest.index("def rows(") :], encoding="utf-8")
    assert before > 0.1  # bias: noise of 4 % of the variance of y(k-1) and y(k-2), which are nearly alike
    assert error(load(path), task) < 0.01


def test_the_page_names_every_field_of_the_data():
    named = set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`.*?) \|", PAGE, flags=re.MULTILINE))))
    assert named == set(Data.__dataclass_fields__)


def test_the_commands_of_the_page_lead_to_rows(tmp_path, monkeypatch):
    """All but those that take minutes or need a network."""
    monkeypatch.chdir(tmp_path)
    assert [c.split()[1] for c in COMMANDS] == ["add", "run", "run", "report", "install", "install", "export"]
    add_, run_, _, report_, install_, _, export_ = COMMANDS
    for command in (add_, run_.replace("/*", "/textbook"), report_, install_, export_):
        assert main(shlex.split(command)) == 0, command
    rows = read("mine.parquet")
    assert sorted(rows["method"]) == ["from_truth", "hammerstein_wiener", "my_arx"]
    assert set(rows["status"]) == {"ok"}
    names = {path.name for path in (tmp_path / "textbook-0").iterdir()}
    assert names == {"train.csv", "test.csv", "scenario.json", "truth.json"}
