"""Methods of other people: what reaches their process and comes back, how they fail, their files and environments."""

import csv
import json
import os
import pickle
import signal
import subprocess
import sys
import textwrap
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.base.criteria import fit_percent
from sysid.base.errors import InputError
from sysid.bench.isolation import Environment, FileMethod, peer_folder
from sysid.bench.method_file import add, load
from sysid.bench.methods import PEERS, TABLE
from sysid.bench.task import Task, Truth, export
from sysid.data.record import IOData
from sysid.structures import hammerstein_wiener

RNG = np.random.default_rng(5)


def arx(u: np.ndarray, first: tuple[float, float]) -> np.ndarray:
    """y(k) = 1.5 y(k-1) - 0.7 y(k-2) + u(k-1) + 0.5 u(k-2) + 0.2."""
    y = np.array([*first, *np.zeros(len(u) - 2)])
    for k in range(2, len(u)):
        y[k] = 1.5 * y[k - 1] - 0.7 * y[k - 2] + u[k - 1] + 0.5 * u[k - 2] + 0.2
    return y


def task(orders: tuple[int, int, int] | None = (2, 2, 1)) -> Task:
    """Two experiments, the second with outputs that were not measured, and a test."""
    a, b, c = RNG.standard_normal(300), RNG.standard_normal(200), RNG.standard_normal(150)
    lost = np.zeros(200, dtype=bool)
    lost[[40, 41]] = True
    train = IOData.merge(IOData(a, arx(a, (0.3, -2.0)), 0.1), IOData(b, arx(b, (5.0, 4.0)), 0.1, missing=lost[:, None]))
    return Task(train, {"test": IOData(c, arx(c, (1.0, 2.0)), 0.1)}, 10, orders=orders)


def given_of(given: Task) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {name: (t.u[:, 0], t.y[: given.drop, 0]) for name, t in given.tests.items()}


def written(folder: Path, body: str, name: str = "mine") -> FileMethod:
    """The method of a file with this text."""
    (folder / f"{name}.py").write_text(textwrap.dedent(body), encoding="utf-8")
    return load(folder / f"{name}.py")


def solve(method: FileMethod, seconds: float = 30.0, given: Task | None = None):
    given = given or task()
    return method.solve(given, given_of(given), seconds, 3)


def test_the_scaffold_finds_the_plant_it_can_describe(tmp_path):
    """The rows that a gap does not touch are exact, so an equation-error fit is too."""
    given = task()
    method = load(add("my_arx", tmp_path))
    assert (method.name, method.requirements) == ("my_arx", ())
    outcome = solve(method, given=given)
    assert outcome.status == "ok"
    np.testing.assert_allclose(outcome.runs["test"], given.tests["test"].y[:, 0], atol=1e-9)
    poles = np.array([complex(*z) for z in outcome.details["poles"]])
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(np.roots([1.0, -1.5, 0.7])), atol=1e-9)
    assert outcome.details["structure"] == "ARX 2, 2, 1"
    assert 0.0 < outcome.seconds < 10.0
    assert outcome.memory > 5.0 or np.isnan(outcome.memory)


def test_the_data_arrives_and_the_answer_returns_bit_for_bit(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    body = """
    import json
    import os

    import numpy as np

    def fit(data):
        return Echo(data)

    class Echo:
        def __init__(self, data):
            flat = lambda parts: [v.tobytes().hex() for v in parts]
            told = {"u": flat(data.u), "y": flat(data.y), "missing": flat(data.missing), "Ts": data.Ts,
                            "orders": data.orders, "seconds": data.seconds, "seed": data.seed,
                    "threads": os.environ["OMP_NUM_THREADS"], "type": data.missing[0].dtype.name}
            with open(WHERE, "w") as file:
                json.dump(told, file)
            self.details = {"loss": np.float32(0.5), "stop": "well", "more": told}

        def simulate(self, u, y_init):
            return np.concatenate([y_init, u[len(y_init):]]) / 3.0
    """
    given = task(None)
    outcome = solve(written(tmp_path, body.replace("WHERE", repr(str(tmp_path / "told.json")))), 7.5, given)
    assert outcome.status == "ok"
    assert outcome.details == {"loss": 0.5, "stop": "well"}  # what the contract has no name for is left out
    sent, got = given.data(7.5, 3), json.loads((tmp_path / "told.json").read_text())
    for name in ("u", "y", "missing"):
        assert got[name] == [v.tobytes().hex() for v in getattr(sent, name)]
    assert (got["Ts"], got["orders"], got["seconds"], got["seed"]) == (0.1, None, 7.5, 3)
    assert (got["threads"], got["type"]) == ("1", "bool")
    u, first = given_of(given)["test"]
    np.testing.assert_array_equal(outcome.runs["test"], np.concatenate([first, u[len(first) :]]) / 3.0)


FAILURES = {
    "raise ValueError('the matrix is singular')": "crashed: ValueError: the matrix is singular",
    "raise NotImplementedError('one experiment alone')": "refused: one experiment alone",
    "import os; print('the last words', flush=True); os._exit(3)": "crashed: exit status 3: the last words",
    "import os; os.kill(os.getpid(), 11)": "crashed: killed by signal 11: ",
    "import no_such_library": "crashed: ModuleNotFoundError: No module named 'no_such_library'",
    "return None": "crashed: AttributeError: 'NoneType' object has no attribute 'simulate'",
    "return type('M', (), {'simulate': lambda self, u, y: u[1:]})()": "crashed: ValueError: simulate gave 149 samples",
}


@pytest.mark.parametrize("body", FAILURES)
def test_a_method_that_fails_gives_a_sentence(tmp_path, body):
    outcome = solve(written(tmp_path, f"def fit(data):\n    {body}\n"))
    assert outcome.status.startswith(FAILURES[body])
    assert not outcome.runs


def gone(pid: int) -> bool:
    """Whether a process has ended, one that nobody has waited for yet included."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def ends(pid: int) -> bool:
    """Whether it does within 20 s: what is killed is gone a little later."""
    until = time.monotonic() + 20.0
    while not gone(pid) and time.monotonic() < until:
        time.sleep(0.02)
    return gone(pid)


ENDLESS = """
    import pathlib
    import subprocess
    import time

    def fit(data):
        child = subprocess.Popen(["sleep", "600"])
        pathlib.Path({where!r}).write_text(str(child.pid))
        while True:
            time.sleep(0.01)
    """


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the processes are looked up in /proc")
def test_a_method_that_does_not_end_is_killed_with_its_children(tmp_path):
    method = written(tmp_path, ENDLESS.format(where=str(tmp_path / "pid")))
    outcome = solve(method, 0.3)
    assert outcome.status == "stopped after 1 s"
    assert 0.9 <= outcome.seconds < 5.0
    assert ends(int((tmp_path / "pid").read_text()))


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the processes are looked up in /proc")
def test_a_method_ends_with_the_process_that_asked_for_it(tmp_path):
    body = """
    import os, pathlib, time

    def fit(data):
        pathlib.Path(%r).write_text(str(os.getpid()))
        time.sleep(600)
    """
    method, given = written(tmp_path, body % str(tmp_path / "pid")), task()
    (tmp_path / "call.pickle").write_bytes(pickle.dumps((method, given, given_of(given))))
    code = "import pickle, sys\nm, t, x = pickle.load(open(sys.argv[1], 'rb'))\nm.solve(t, x, 600.0, 0)"
    parent = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "call.pickle")])
    until = time.monotonic() + 60.0
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
        assert time.monotonic() < until
        time.sleep(0.05)
    pid = int((tmp_path / "pid").read_text())
    assert not gone(pid)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert ends(pid)


def test_imports_do_not_count_as_time_of_the_fit(tmp_path):
    body = "import time\ntime.sleep(1.0)\ndef fit(data):\n    time.sleep(0.2)\n    return M()\n"
    body += "class M:\n    def simulate(self, u, y_init):\n        return u\n"
    assert 0.2 <= solve(written(tmp_path, body)).seconds < 0.9


def wheel(folder: Path, version: str) -> str:
    """A package of one line, as a requirement."""
    path, info = folder / f"tinything-{version}-py3-none-any.whl", f"tinything-{version}.dist-info"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("tinything.py", f"value = {version!r}\n")
        file.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: tinything\nVersion: {version}\n")
        file.writestr(
            f"{info}/WHEEL", "Wheel-Version: 1.0\nGenerator: a test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        file.writestr(f"{info}/RECORD", "")
    return f"tinything @ {path.as_uri()}"


def test_an_environment_is_made_once_and_anew_for_other_requirements(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    offline = ("--no-index", "--no-deps")
    one, two = (Environment("mine", (wheel(tmp_path, v),), offline) for v in ("1.0", "2.0"))
    with pytest.raises(InputError, match=r"^not installed: run qpal bench install mine$"):
        one.python()
    python = one.install()
    assert python == one.python()
    assert python.is_relative_to(tmp_path / "cache" / "qpal" / "peers" / "mine")
    told = subprocess.run([python, "-c", "import tinything; print(tinything.value)"], capture_output=True, text=True)
    assert told.stdout.strip() == "1.0"
    made = python.lstat().st_mtime_ns
    assert one.install().lstat().st_mtime_ns == made
    with pytest.raises(InputError, match="not installed"):
        two.python()
    bad = Environment("mine", ("no-such-thing-anywhere",), offline)
    with pytest.raises(InputError, match="no-such-thing-anywhere"):
        bad.install()
    with pytest.raises(InputError, match=r"not installed \(.*no-such-thing-anywhere.*\): run qpal bench install mine"):
        bad.python()


def test_a_method_without_its_environment_says_so_in_its_row(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    method = written(tmp_path, "REQUIREMENTS = ['nowhere']\ndef fit(data): ...\n")
    assert solve(method).status == f"not installed: run qpal bench install {tmp_path / 'mine.py'}"
    assert solve(PEERS["nfoursid"]).status == "not installed: run qpal bench install nfoursid"


BAD = {
    "def fit(data:\n": r"line 1: .*; correct it",
    "def other(data): ...\n": r"has no function fit\(data\)",
    "def fit(data, more): ...\n": "takes other arguments",
    "def fit(): ...\n": "takes other arguments",
    "def fit(data, *, more): ...\n": "takes other arguments",
    "def fit(data):\n    from sysid.bench import task\n": "line 2 imports sysid.bench",
    "REQUIREMENTS = 'scipy'\ndef fit(data): ...\n": "REQUIREMENTS in .* must be a plain list of strings",
    "PIP_OPTIONS = [1]\ndef fit(data): ...\n": "PIP_OPTIONS in .* must be a plain list of strings",
    "PACKAGE = ['scipy']\ndef fit(data): ...\n": "PACKAGE in .* give the name of one package",
}


@pytest.mark.parametrize("text", BAD)
def test_files_that_are_no_methods_are_refused(tmp_path, text):
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=BAD[text]):
        load(tmp_path / "mine.py")


def test_what_a_file_says_about_itself(tmp_path):
    head = '"""First line.\n\nMore."""\nREQUIREMENTS: list[str] = ["tiny-thing[all]>=0.5", "numpy"]\n'
    method = written(tmp_path, head + "PIP_OPTIONS = ('--pre',)\ndef fit(data, more=1): ...\n")
    path = str((tmp_path / "mine.py").resolve())
    assert method == FileMethod("mine", "First line", path, ("tiny-thing[all]>=0.5", "numpy"), "tiny-thing", ("--pre",))
    assert written(tmp_path, "PACKAGE = 'other'\ndef fit(data): ...\n").package == "other"
    assert pickle.loads(pickle.dumps(method)) == method


def test_the_scaffold_overwrites_nothing(tmp_path):
    path = add("mine", tmp_path)
    path.write_text("my work", encoding="utf-8")
    with pytest.raises(InputError, match="exists already"):
        add("mine", tmp_path)
    assert path.read_text(encoding="utf-8") == "my work"
    with pytest.raises(InputError, match="no name for a method"):
        add("../mine", tmp_path)
    with pytest.raises(InputError, match="there is no method file"):
        load(tmp_path / "none.py")


def test_every_peer_is_in_the_table_and_says_what_it_is():
    assert set(PEERS) <= set(TABLE)
    assert len(PEERS) == 6
    for name, method in PEERS.items():
        assert method.name == name
        assert method.about
        assert method.package
        assert (peer_folder() / f"{name}.py").read_text(encoding="utf-8").isascii()


def test_forty_lines_find_a_hammerstein_wiener_plant():
    """Noise of 0.1 %: the poles of the fit stay within 0.002 although its maps break elsewhere than the plant's."""
    rng = np.random.default_rng(0)
    u = rng.uniform(-2.0, 2.0, 300).repeat(5)

    def plant(u: np.ndarray) -> np.ndarray:
        w = lfilter([0.0, 0.4, 0.2], [1.0, -1.5, 0.7], np.clip(u, -1.0, 1.4))
        return np.tanh(0.6 * w)

    y, test = plant(u), rng.uniform(-2.0, 2.0, 300).repeat(5)
    clean, test = plant(test)[203:], test[203:]  # a record that begins in motion
    train = IOData(u, y + 1e-3 * y.std() * rng.standard_normal(len(u)), 0.1)
    given = Task(train, {"test": IOData(test, clean, 0.1)}, 10, orders=(2, 2, 1))
    outcome = solve(PEERS["forty_lines"], given=given)
    assert outcome.status == "ok"
    run = outcome.runs["test"]
    assert fit_percent(clean[10:], run[10:]) > 97.0
    assert np.abs(run - clean)[:10].max() < 0.1 * clean.std()
    poles = np.sort_complex([complex(*z) for z in outcome.details["poles"]])
    np.testing.assert_allclose(poles, np.sort_complex(np.roots([1.0, -1.5, 0.7])), atol=2e-3)


def cells(path: Path) -> dict[str, list[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    return dict(zip(rows[0], map(list, zip(*rows[1:], strict=True)), strict=True))


def floats(column: list[str]) -> np.ndarray:
    return np.array([float(v) if v else np.nan for v in column])


def test_an_exported_task_reads_back_bit_for_bit(tmp_path):
    chain = hammerstein_wiener(2, 2, 1, "saturation", "unit_gain")
    given = task()
    clean = RNG.standard_normal(150) * 1e-9
    theta = RNG.standard_normal(len(chain.names))
    truth = Truth({"test": clean}, 0.1 + 0.2, np.array([0.75 + 0.3j, 0.75 - 0.3j]), chain, theta)
    given = Task(given.train, given.tests, 10, "rad", (2, 2, 1), truth, {"theirs": "0.1 rad"}, "two poles")
    where = export(given, tmp_path / "data")
    scenario = json.loads((where / "scenario.json").read_text(encoding="utf-8"))
    assert [scenario[name] for name in ("Ts", "drop", "unit", "orders")] == [0.1, 10, "rad", [2, 2, 1]]
    assert scenario["train"] == [{"file": "train-1.csv", "length": 300}, {"file": "train-2.csv", "length": 200}]
    assert scenario["tests"] == {"test": [{"file": "test.csv", "length": 150}]}
    assert (scenario["given"], scenario["published"]) == ("two poles", {"theirs": "0.1 rad"})
    records = [*given.train.experiments, given.tests["test"]]
    for name, record in zip(("train-1", "train-2", "test"), records, strict=True):
        columns = cells(where / f"{name}.csv")
        np.testing.assert_array_equal(floats(columns["t"]), np.arange(record.N) * 0.1)
        np.testing.assert_array_equal(floats(columns["u"]), record.u[:, 0])
        y = floats(columns["y"])
        np.testing.assert_array_equal(y, np.where(record.observed[:, 0], record.y[:, 0], np.nan))
        assert ("y_true" in columns) == (name == "test")
    assert np.flatnonzero(np.isnan(floats(cells(where / "train-2.csv")["y"]))).tolist() == [40, 41]
    np.testing.assert_array_equal(floats(cells(where / "test.csv")["y_true"]), clean)
    told = json.loads((where / "truth.json").read_text(encoding="utf-8"))
    assert told["noise"] == truth.noise
    assert [complex(*z) for z in told["poles"]] == truth.poles.tolist()
    assert [told["parameters"][name] for name in chain.names] == theta.tolist()
    assert told["structure"] == "hammerstein_wiener"
    with pytest.raises(InputError, match="not empty"):
        export(given, where)


def test_a_task_without_truth_and_with_several_tests_has_files_of_its_own(tmp_path):
    given = task(None)
    one, two = given.tests["test"], given.train.experiments[0]
    where = export(Task(given.train, {"slow ramp": one, "slow/ramp": two}, 10), tmp_path / "new" / "data")
    names = ["scenario.json", "test-1-slow_ramp.csv", "test-2-slow_ramp.csv", "train-1.csv", "train-2.csv"]
    assert sorted(os.listdir(where)) == names
    scenario = json.loads((where / "scenario.json").read_text(encoding="utf-8"))
    assert scenario["orders"] is None
    assert scenario["tests"]["slow/ramp"] == [{"file": "test-2-slow_ramp.csv", "length": 300}]


def test_a_method_gets_a_seed_that_every_library_takes(tmp_path):
    """scikit-learn and numpy's old generators refuse 2^32 and more; a method may multiply its seed."""
    path = tmp_path / "told.py"
    path.write_text(
        "import numpy as np\n\n\n"
        "class Told:\n"
        "    def __init__(self, seed):\n"
        "        self.details = {'stop': str(seed)}\n\n"
        "    def simulate(self, u, y_init):\n"
        "        return np.zeros(len(u))\n\n\n"
        "def fit(data):\n"
        "    return Told(data.seed)\n"
    )
    found = load(path).solve(task(), {"a": (np.ones(9), np.zeros(2))}, 9.0, 10**12 + 7)
    assert found.status == "ok"
    assert int(found.details["stop"]) == (10**12 + 7) % 2**20
