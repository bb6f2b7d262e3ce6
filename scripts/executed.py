"""Which tests execute which lines, from one run of them under coverage with a context for each."""

import ast
import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections import defaultdict
from functools import cache
from pathlib import Path

import coverage

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("sysid", "twin")

PLUGIN = """
import json, os, warnings, coverage
cov = coverage.Coverage(data_file=os.environ["MUTANTS"] + "/cover", data_suffix=True, source=["sysid", "twin"],
                        concurrency="thread", config_file=False)
cov.start()
seconds = {}
def pytest_runtest_setup(item): cov.switch_context("setup|" + item.nodeid)
def pytest_runtest_call(item): cov.switch_context("call|" + item.nodeid)
def pytest_runtest_teardown(item): cov.switch_context("")
def pytest_runtest_logreport(report):
    if report.when == "call" and report.passed: seconds[report.nodeid] = report.duration
def pytest_sessionfinish(session):
    cov.stop()
    with warnings.catch_warnings(action="ignore"): cov.save()  # the process that only deals tests out has none
    with open(f"{os.environ['MUTANTS']}/seconds-{os.getpid()}.json", "w") as file: json.dump(seconds, file)
"""


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


class Map:
    """Which tests execute which line, from recorded contexts; `seconds` of the tests that passed."""

    def __init__(self, folder: Path) -> None:
        lines_by_test = [json.loads(path.read_text()) for path in folder.glob("seconds-*.json")]
        self.seconds: dict[str, float] = {name: s for part in lines_by_test for name, s in part.items()}
        self.files: dict[str, list[str]] = defaultdict(list)
        for name in self.seconds:
            self.files[name.split("::")[0]].append(name)
        self.lines: dict[tuple[str, int], set[str]] = defaultdict(set)
        for path in folder.glob("cover.*"):
            data = coverage.CoverageData(str(path))
            data.read()
            for file in data.measured_files():
                for line, contexts in data.contexts_by_lineno(file).items():
                    for kind, _, name in (c.partition("|") for c in contexts if c):
                        # What a fixture does may be for other tests of the file too.
                        others = self.files[name.split("::")[0]] if kind == "setup" else [name]
                        self.lines[os.path.relpath(file, ROOT), line] |= set(others) & self.seconds.keys()
        self.named: dict[str, list[tuple[Path, int, str]]] = defaultdict(list)  # name -> where, and the owner there
        for path in (p for package in PACKAGES for p in (ROOT / package).rglob("*.py")):
            for top in tree(path).body:
                for node in ast.walk(top):
                    name = getattr(node, "id", getattr(node, "attr", None))
                    if name and not isinstance(node, ast.ImportFrom) and isinstance(node.ctx, ast.Load):
                        self.named[name].append((path, node.lineno, owner(path, node.lineno)))

    def tests(self, path: Path, first: int, last: int) -> set[str]:
        """Tests that execute one of these lines or, where none is seen to, lines that name what they belong to."""
        found = set().union(*(self._at(path, line) for line in range(first, last + 1)))
        names, seen = {owner(path, first)} - {""}, {""}
        while not found and names:
            seen |= names
            near = [place for name in names for place in self.named[name]]
            found = found.union(*(self._at(path, line) for path, line, _ in near))
            names = {other for path, line, other in near if not self._at(path, line)} - seen
        return found

    def _at(self, path: Path, line: int) -> set[str]:
        return self.lines.get((os.path.relpath(path, ROOT), line), set())


def owner(path: Path, line: int) -> str:
    """Name of what holds this line where coverage cannot see it run: a compiled function or, at import, its target."""
    top = next((n for n in tree(path).body if n.lineno <= line <= n.end_lineno), None)
    if isinstance(top, ast.Assign | ast.AnnAssign | ast.AugAssign):
        target = top.targets[0] if isinstance(top, ast.Assign) else top.target
        return getattr(target, "id", "")
    inner = [n for n in getattr(top, "body", ()) if isinstance(n, ast.FunctionDef) and n.lineno <= line <= n.end_lineno]
    return getattr(inner[0] if inner and isinstance(top, ast.ClassDef) else top, "name", "")


def record(store: Path, arguments: str) -> Path:
    """The folder with the contexts of these sources and tests, recorded if it is not there."""
    sources = sorted(p for package in (*PACKAGES, "tests") for p in (ROOT / package).rglob("*.py"))
    state = hashlib.sha256(b"".join(p.read_bytes() for p in sources) + arguments.encode()).hexdigest()[:12]
    folder = store / f"map-{state}"
    if not (folder / "done").exists():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        (folder / "mutants_plugin.py").write_text(PLUGIN)
        where = os.pathsep.join([str(ROOT), str(folder)])
        command = [sys.executable, "-m", "pytest", "-q", "-p", "mutants_plugin", *arguments.split()]
        subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": where, "MUTANTS": str(folder)}, check=False)
        (folder / "done").touch()
    return folder
