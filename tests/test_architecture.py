"""What must not drift in the house: which way imports run, that tables are complete, that exported names exist."""

import ast
import importlib
import inspect
import pkgutil
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import sysid
import twin
from sysid.base import handlers

PACKAGES = (sysid, twin)
# The rooms of each package from the ground up, floor by floor: a room imports rooms of lower floors alone.
FLOORS = {
    "sysid": (
        ("base",),
        ("block", "data", "drawing", "excitations", "solver"),
        ("motor_parts",),
        ("blocks", "diagnosis", "formats"),
        ("channels", "model"),
        ("estimation",),
        ("nlarx", "uncertainty"),
        ("fitting",),
        ("export", "structures", "validation"),
        ("linear", "plots", "selection", "systems"),
        ("joint",),
        ("bench", "workflow"),
        ("report",),
        ("notebook",),
    ),
    "twin": (
        ("imperfections",),
        ("parameters",),
        ("hardware",),
        ("log", "parameter_file", "plant"),
        ("experiment", "robot", "truth"),
        ("design", "ensemble", "follow", "fragment", "pendulum", "signatures", "view"),
        ("bench", "calibrate", "compare", "studies"),
        ("mjcf", "rig"),
        ("report",),
        ("app",),
        ("cli",),
    ),
}
# Extension points: one file, one entry in the folder's TABLE.
FOLDERS = (
    "sysid.blocks",
    "sysid.estimation.starts",
    "sysid.excitations",
    "sysid.formats",
    "sysid.motor_parts",
    "sysid.plots",
    "sysid.solver.searches",
    "sysid.structures",
    "sysid.systems",
    "twin.imperfections",
)
NOT_FOR_SYSID = ("twin", "mujoco")
LONGEST = 400


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def sources(package) -> list[Path]:
    return sorted(Path(package.__file__).parent.rglob("*.py"))


def modules() -> list[str]:
    found = [package.__name__ for package in PACKAGES]
    for package in PACKAGES:
        found += [m.name for m in pkgutil.walk_packages(package.__path__, package.__name__ + ".")]
    return [name for name in found if not name.endswith("__main__")]


def imported(path: Path) -> set[str]:
    """Top-level names that a file imports anywhere in it, inside functions too."""
    names = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module.split(".")[0])
        elif isinstance(node, ast.ImportFrom):
            names.add(f"relative import in {path.name}, line {node.lineno}")  # absolute ones can be checked
    return names


def files_of(package) -> dict[str, Path]:
    """Every module of a package by its dotted name."""
    root = Path(package.__file__).parent
    names = {".".join((package.__name__, *p.relative_to(root).with_suffix("").parts)): p for p in sources(package)}
    return {name.removesuffix(".__init__"): path for name, path in names.items()}


def arrows(package) -> dict[str, set[str]]:
    """Every module and the modules of its package that it imports, anywhere in it; the package's facade left out."""
    files = files_of(package)
    found: dict[str, set[str]] = {}
    for name, path in files.items():
        used = set()
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Import):
                used |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    below = f"{node.module}.{alias.name}"
                    used.add(below if below in files else str(node.module))
        found[name] = used & set(files) - {name, package.__name__}
    return found


def room(name: str) -> str:
    return name.split(".")[1]


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.__name__)
def test_every_room_has_its_floor_and_imports_from_lower_floors_alone(package):
    floors = {name: level for level, names in enumerate(FLOORS[package.__name__]) for name in names}
    used = {name: below for name, below in arrows(package).items() if name != package.__name__}
    assert {room(name) for name in used} == set(floors)
    wrong = [
        f"{name} imports {other}"
        for name, below in used.items()
        for other in below
        if room(name) != room(other) and floors[room(name)] <= floors[room(other)]
    ]
    assert not wrong


def test_only_the_handlers_of_base_reach_up_and_only_to_the_top_floor():
    """Methods that need higher rooms are found by name in one place; the room they are in is imported by none."""
    assert FLOORS["sysid"][-1] == (handlers.ROOM.split(".")[1],)
    naming = [p.name for p in sources(sysid) if f'"{handlers.ROOM}' in p.read_text(encoding="utf-8")]
    assert naming == ["handlers.py"]
    for name, module in handlers.MODULES.items():
        found = getattr(importlib.import_module(f"{handlers.ROOM}.{module}"), f"{name}View")
        assert callable(found.line), name
        assert callable(found.card), name


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.__name__)
def test_imports_run_in_no_circle(package):
    """Facades of rooms count too; that of the package is for users, and no module takes names from it."""
    graph = {name: below for name, below in arrows(package).items() if name != package.__name__}
    TopologicalSorter(graph).prepare()  # CycleError names the circle


def test_no_module_takes_names_from_the_facade():
    """The facade is for users: what is inside says from which room a name comes."""
    wrong = []
    for path in sources(sysid):
        nodes = list(ast.walk(tree_of(path)))
        plain = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
        taken = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.module == "sysid"]
        if path.parent != Path(sysid.__file__).parent and (taken or "sysid" in plain):
            wrong.append(str(path))
    assert not wrong


def test_sysid_knows_no_robot():
    names = [(str(path), name) for path in sources(sysid) for name in imported(path)]
    wrong = [pair for pair in names if pair[1] in NOT_FOR_SYSID or pair[1].startswith("relative")]
    assert not wrong


def test_importing_all_of_sysid_loads_no_robot():
    names = [name for name in modules() if name.startswith("sysid")]
    code = f"import importlib, sys\nfor n in {names!r}: importlib.import_module(n)\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in done.stdout.split()}
    assert "sysid" in loaded
    assert not loaded & set(NOT_FOR_SYSID)
    assert "matplotlib" not in loaded  # drawing libraries are imported by what draws


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_file_of_an_extension_folder_is_in_its_table(folder):
    package = importlib.import_module(folder)
    public = [m.name for m in pkgutil.iter_modules(package.__path__) if not m.ispkg and not m.name.startswith("_")]
    files = {f"{folder}.{name}" for name in public}
    # Classes and functions know the module that defines them, instances have a function that does.
    in_table = {inspect.unwrap(getattr(entry, "term", entry)).__module__ for entry in package.TABLE.values()}
    assert files == in_table


def test_every_exported_name_exists():
    loaded = [importlib.import_module(name) for name in modules()]
    exported = [(module, name) for module in loaded for name in getattr(module, "__all__", ())]
    wrong = [f"{module.__name__}.{name}" for module, name in exported if getattr(module, name, None) is None]
    assert not wrong


def stub() -> dict[str, str | None]:
    """Public names of sysid and the modules that the stub says they come from, None for modules themselves."""
    tree = ast.parse(Path(sysid.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    found = [(node.module, alias) for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    assert all(alias.asname == alias.name for _, alias in found)  # else a type checker does not see it
    return {alias.name: module for module, alias in found}


def test_sysid_offers_every_public_name_and_nothing_else():
    assert dir(sysid) == sorted(sysid.__all__) == sorted(stub())
    assert {"blocks", "select", "fit", "structures"} <= set(dir(sysid))


def test_every_name_of_the_stub_resolves_where_it_says():
    """By attribute access; where a function bears its module's name, the function, whoever imported the module."""
    for name, where in stub().items():
        module = importlib.import_module(f"sysid.{where or name}")
        assert getattr(sysid, name) is (getattr(module, name) if where else module), name


def test_a_name_that_has_moved_says_where_it_is_and_a_room_is_reached_though_it_is_not_listed():
    assert len(dir(sysid)) < 40
    with pytest.raises(AttributeError, match=r"is sysid\.diagnosis\.residuals\.higher_order_tests now"):
        _ = sysid.higher_order_tests
    for name, room in sysid._MOVED.items():
        assert hasattr(importlib.import_module(f"sysid.{room}"), name)
    assert sysid.workflow is importlib.import_module("sysid.workflow")
    with pytest.raises(AttributeError, match="sysid has no 'nowhere'; it has "):
        _ = sysid.nowhere


def test_importing_sysid_is_light():
    code = "import sys, sysid; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert not loaded & {"numpy", "scipy", "numba", "control", "pydantic"}
    assert {name for name in loaded if name.startswith("sysid")} == {"sysid"}


def test_a_type_checker_sees_every_public_name(tmp_path):
    api = pytest.importorskip("mypy.api", reason="mypy is in the dev extra")
    lines = ["import sysid", *(f"sysid.{name}" for name in sorted(stub())), "sysid.nowhere"]
    script = tmp_path / "names.py"
    script.write_text("\n".join(lines) + "\n")
    root = Path(__file__).parents[1]  # of the settings; the package may be installed elsewhere
    said = api.run(["--config-file", str(root / "pyproject.toml"), "--follow-imports=silent", str(script)])[0]
    errors = [line for line in said.splitlines() if "error:" in line]
    assert len(errors) == 1, said
    assert 'Module has no attribute "nowhere"' in errors[0]


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.__name__)
def test_packages_say_that_they_are_typed(package):
    assert (Path(package.__file__).parent / "py.typed").is_file()  # PEP 561


def test_no_module_is_a_second_house():
    paths = [path for package in PACKAGES for path in sources(package)]
    long = [str(path) for path in paths if len(path.read_text(encoding="utf-8").splitlines()) > LONGEST]
    assert not long


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.__name__)
def test_the_facade_reaches_every_module_of_every_public_room(package):
    """By attributes alone, in a fresh process where nothing has been imported beside the package."""
    own = [name.split(".") for name in modules() if name.startswith(f"{package.__name__}.") and "._" not in name]
    wanted = [".".join(parts) for parts in own if len(parts) == 3 and parts[1] in dir(package)]
    known = [name for name in wanted if not _shadowed(name)]
    assert len(known) > 20
    code = f"import {package.__name__}\n" + "\n".join(f"assert {name}.__name__ == {name!r}" for name in known)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-500:]


def _shadowed(name: str) -> bool:
    """Whether a class or function of the room bears its module's name, as in folders of one thing a file."""
    room, _, last = name.rpartition(".")
    return not inspect.ismodule(getattr(importlib.import_module(room), last, sys))
