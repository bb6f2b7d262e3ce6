"""Loops compiled by a second process: it starts only where it helps, fills the cache, and may fail."""

import io
import os
import pickle
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from numba import typeof
from numba.core.caching import NullCache

from sysid.base import compiled
from sysid.base.errors import InputError
from sysid.block import ahead, kernels
from sysid.block.block import Block
from sysid.blocks import Motor, dynamic
from sysid.structures import TABLE, ActuatedJoint
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting
from twin.cli import main

TEXT = "def step(s, x, p):\n    s.a = {} * s.a + p.g * x\n    return s.a\n"


class Process:
    """What `subprocess.Popen` gives."""

    def __init__(self, command, **options) -> None:
        self.command, self.options, self.code, self.message = command, options, None, None
        started.append(self)

    def communicate(self, message):
        self.message = message

    def poll(self):
        return self.code


started: list[Process] = []


@pytest.fixture
def block(tmp_path, monkeypatch):
    """A block whose loops nobody has compiled, two cores, and a second process that does nothing."""
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "loops"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(ahead, "available_cores", lambda: 2)
    monkeypatch.setattr(ahead.os, "getloadavg", lambda: (0.0, 9.0, 9.0))
    monkeypatch.setattr(ahead.os, "cpu_count", lambda: 4)
    monkeypatch.setattr(ahead.subprocess, "Popen", Process)
    monkeypatch.setattr(ahead, "_begun", [])
    monkeypatch.setattr(ahead.atexit, "register", lambda *_: None)
    started.clear()
    number = int.from_bytes(os.urandom(4), "big") / 2**33
    return dynamic(TEXT.format(number), {"g": 2.0})


def test_a_process_starts_with_the_blocks_and_only_one_at_a_time(block):
    ahead.compile_ahead([block])
    ahead.compile_ahead([block])
    (process,) = started
    assert process.command[-1] == str(os.getpid())
    assert pickle.loads(process.message) == (block,)
    assert process.options["stdout"] == process.options["stderr"] == subprocess.DEVNULL
    process.code = 0
    ahead.compile_ahead([block])  # it has ended without its work
    assert len(started) == 2


def test_what_it_does_leaves_nothing_to_start_for(block, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["-c", "1"])
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(pickle.dumps(("no block", block)))))
    calls = []
    for name in ("end_with", "leave_to_others"):
        monkeypatch.setattr(ahead, name, lambda *given, name=name: calls.append((name, *given)))
    monkeypatch.setattr(ahead.gc, "disable", lambda: None)
    ahead.main()
    assert calls == [("end_with", 1), ("leave_to_others",)]
    again = dynamic(block.text, {"g": 2.0})
    with compiled.refusing_compilation() as refused:  # as of another process: from the disk
        del sys.modules[again._kernels[0].__name__]
        fresh = dynamic(block.text, {"g": 2.0})
        assert fresh.output(np.array([2.0]), np.ones(2))[0] == 2.0
    assert not refused
    ahead.compile_ahead([fresh])
    assert not started


def test_nothing_starts_where_it_would_be_of_no_use(block, monkeypatch):
    with monkeypatch.context() as m:
        m.setattr(ahead, "available_cores", lambda: 1)
        ahead.compile_ahead([block])
    with monkeypatch.context() as m:
        m.setattr(ahead.os, "getloadavg", lambda: (4.0, 0.0, 0.0))
        ahead.compile_ahead([block])
    with monkeypatch.context() as m:  # Windows: no locks
        m.setattr(ahead.importlib.util, "find_spec", lambda name: None if name == "fcntl" else 1)
        ahead.compile_ahead([block])
    with monkeypatch.context() as m:  # no folder that can be written to
        m.setattr(kernels.scale_columns, "_cache", NullCache())
        ahead.compile_ahead([block])
    with compiled.refusing_compilation():
        ahead.compile_ahead([block])
    assert not started
    ahead.compile_ahead([block])
    assert len(started) == 1


def test_a_process_that_cannot_start_is_no_trouble(block, monkeypatch):
    def full(*_, **__):
        raise OSError("no room for a process")

    monkeypatch.setattr(ahead.subprocess, "Popen", full)
    ahead.compile_ahead([block])
    assert block.output(np.array([2.0]), np.ones(2)).tolist()[0] == 2.0


def test_the_process_itself_fills_the_cache_and_is_over_with_its_parent(tmp_path):
    code = (
        "from sysid.block import ahead\nfrom sysid.blocks import Saturation, TransferFunction\n"
        "ahead.available_cores, ahead._is_busy = lambda: 2, lambda: False\n"
        "ahead.compile_ahead([Saturation()])\nprint(ahead._begun[0].wait())\n"
        "ahead.compile_ahead([TransferFunction(nb=1, nf=1, nk=0)])\nprint(ahead._begun[0].pid)\n"
    )
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    ended, left = map(int, done.stdout.split())
    assert ended == 0
    assert list(tmp_path.rglob("*.value*.nbc"))
    with pytest.raises(ProcessLookupError):
        os.kill(left, 0)


def test_a_fit_of_a_file_begins_with_it_before_anything_is_read(monkeypatch):
    told = []
    monkeypatch.setattr("sysid.workflow.identification.compile_ahead", told.append)
    recipe = ActuatedJoint(load="none")
    with pytest.raises(InputError):
        identify_file("no such file.csv", Setting(recipe))
    assert told == [recipe.blocks_to_compile()]


@pytest.mark.parametrize(
    ("words", "count"), [(["--structure", "actuated-joint"], 1), ([], 1), (["--structure", "auto"], 0)]
)
def test_the_command_begins_with_it_before_the_rest_of_the_program_is_loaded(words, count, monkeypatch):
    told = []
    monkeypatch.setattr(ahead, "compile_ahead", told.append)
    monkeypatch.setattr("twin.cli.identify._frequency_data", lambda *_, **__: pytest.fail("too late"))
    with pytest.raises(pytest.fail.Exception):
        main(["identify", "no such file.csv", *words])
    assert len(told) == count
    assert all(isinstance(b, Block) for blocks in told for b in blocks)


@pytest.mark.parametrize(("name", "long"), [("process", False), ("nlarx", False), ("servo_joint", True)])
def test_only_structures_that_compile_for_long_ask_for_it(name, long):
    blocks = TABLE[name]().blocks_to_compile()
    assert [b.role for b in blocks[:1]] == ["motor"] * long


def test_a_fork_of_the_process_does_not_end_its_second_one():
    process = SimpleNamespace(poll=lambda: None, kill=lambda: pytest.fail("ended"))
    ahead._end(process, os.getpid() + 1)


def test_the_motor_is_compiled_first_and_for_the_arguments_of_a_fit():
    """Each kind of array is another loop."""
    chain = ActuatedJoint().model()
    motor, *others = ActuatedJoint().blocks_to_compile()
    assert isinstance(motor, Motor)
    assert {type(b) for b in chain.blocks} < {type(b) for b in (motor, *others)}
    kinds: dict[str, list] = {"value": [], "tangent": []}
    module = SimpleNamespace(
        MEMORYLESS=False,
        **{name: lambda *given, name=name: kinds[name].append([typeof(a) for a in given]) for name in kinds},
    )
    in_chain = chain.blocks[[b.role for b in chain.blocks].index("motor")]
    for each in (motor, in_chain):
        each.__dict__["_kernels"] = (module, each._kernels[1])
    for columns in (1, 0):
        ahead._run(motor, columns)
    u = np.zeros(20)
    theta = np.full(len(chain.names), 0.5)
    chain.sensitivities(theta, u)
    chain.outputs(theta, u)
    for name, (first, second) in kinds.items():
        assert first == second, name
