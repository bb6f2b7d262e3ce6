"""How the house stands: files that a walk enters, lines and files by room, circles of imports, names by kind.

    python scripts/house.py walks            # files entered by five walks and two fits, on warm caches
    python scripts/house.py lines            # lines and files by room
    python scripts/house.py circles          # modules that import each other, facades and lazy imports counted
    python scripts/house.py rooms            # writes the tables of docs/house.md from the docstrings of the rooms
    python scripts/house.py names [FOLDER]   # names that are an adverb, a participle, a preposition or a pronoun

A walk enters a file when it calls a Python function of it; imports, comprehensions and compiled loops do not count.
A name counts when it is such a word alone, or several such words; `seen = x > 0` is a flag and may be an adjective.
"""

import argparse
import ast
import re
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from io import StringIO
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("sysid", "twin")
NOUNS_IN_ED = ["bed", "feed", "need", "reed", "red", "seed", "speed", "embed", "exceed", "bleed", "weed", "creed"]
WORDS = {
    "adverb": """about above across afresh after again ago ahead all alone along already also always anew apart around
        aside away back backward before behind below beneath besides better beyond down early elsewhere enough ever
        everywhere far farther first_of_all forward further here hence in indeed inside instead just last_of_all late
        later less likely more most much near nearly never next_to now nowhere off often on once only onward
        outside over perhaps quite rather since so soon still straight then there thus today together too twice under
        up upside upward usually very well when where why within worse""",
    "preposition": """against among and as at because beside besides between but by despite during except for from if
        into like of onto or per than through throughout till to toward towards unless until upon via while with
        without""",
    "pronoun": """another any anything both each either everyone everything few he her him his how it its many me
        mine my neither none nobody nothing one ones other others our ours own same several she some somebody something
        such that their theirs them these they this those us we what whatever which who whole whom whose you your
        yours""",
    "participle": """bare beaten become begun bent bitten blown born borne bound bought broken brought built burnt
        caught chosen come crept cut dealt done drawn driven drunk eaten fallen fed fell felt fled flown forgotten
        fought found frozen given gone got grown had heard held hidden kept knelt known laid leant led left lent lit
        lost made meant met misspelt paid proven put read_aloud ridden rung risen said sawn seen sent set_apart sewn
        shaken shown shrunk shut slept slid sold sought sown spelt spent spilt split_up spoken spoilt spread_out sprung
        standing stolen stood stuck struck sunk sworn swept swum swung taken taught thrown told torn thought unheld
        unmet unread unsaid unseen understood unspoken woken won worn woven written""",
}
KIND_OF = {word: kind for kind, words in WORDS.items() for word in words.split()}


def sources(folder: str = "") -> list[Path]:
    """The library's Python files, or those below one folder of the project."""
    return sorted(path for top in ([folder] if folder else PACKAGES) for path in (ROOT / top).rglob("*.py"))


def room_of(path: Path) -> str:
    """`sysid/base` of sysid/base/files.py; the package itself for a module that stands directly in it."""
    parts = path.relative_to(ROOT).parts
    return "/".join(parts[:2]) if len(parts) > 2 else parts[0]


# ---- walks


def entered(walk: Callable[[], object]) -> set[str]:
    """Files of the project in which the walk calls a Python function."""
    files: set[str] = set()
    shared = ("<module>", "<listcomp>", "<genexpr>", "<dictcomp>", "<setcomp>", "<lambda>", "__getattr__")

    def profile(frame, event, _argument) -> None:
        name = frame.f_code.co_name
        compiled = "__name__" not in frame.f_globals  # numba tells the profiler of its loops, in frames of no module
        if event == "call" and name not in shared and not compiled:
            files.add(frame.f_code.co_filename)

    sys.setprofile(profile)
    try:
        walk()
    finally:
        sys.setprofile(None)
    packages = [f"{ROOT / name}/" for name in PACKAGES]
    sources_entered = (name for name in files if name.startswith(tuple(packages)) and name.endswith(".py"))
    return {str(Path(name).relative_to(ROOT)) for name in sources_entered}


def walks(folder: Path) -> dict[str, Callable[[], object]]:
    """The walks by name; the first of them writes what the later ones read."""
    import numpy as np

    import sysid
    import twin

    csv = folder / "thigh.csv"
    chain = sysid.structures.hammerstein_wiener(nb=2, nf=2, nk=1, input="saturation", output="piecewise_linear")
    chain = getattr(chain, "chain", chain)
    line = sysid.structures.output_error(nb=2, nf=2, nk=1)
    rng = np.random.default_rng(0)
    theta = rng.uniform(0.1, 0.2, len(chain.names))
    experiment = twin.Experiment(joint="thigh", excitation="sweep", duration=60.0, Ts=0.1, seed=1)
    experiment.run().save(csv)
    data = sysid.read(csv)
    fit = sysid.fit(chain, data)

    def to_jacobian() -> object:
        return chain.tangent(theta, sysid.read(csv).u)

    return {
        "voltage to log": lambda: experiment.run(),
        "CSV to rows": lambda: sysid.read(csv),
        "CSV to Jacobian": to_jacobian,
        "fit to result (Hammerstein-Wiener)": lambda: sysid.fit(chain, data),
        "fit to result (linear, one start)": lambda: sysid.fit(line, data, starts=1),
        "fit to page": lambda: fit.report(folder / "fit.html", validation=data),
        "qpal identify": lambda: _identify(csv, folder / "out"),
    }


def _identify(csv: Path, out: Path) -> None:
    """`qpal identify` in this process; typer ends it by SystemExit."""
    import shutil

    from twin.cli import main

    shutil.rmtree(out, ignore_errors=True)
    before, sys.argv = sys.argv, ["qpal", "identify", str(csv), "--structure", "hammerstein_wiener", "--out", str(out)]
    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            main()
    except SystemExit as end:
        if end.code:
            raise RuntimeError(f"qpal identify ended with {end.code}") from None
    finally:
        sys.argv = before


def show_walks(listed: bool) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name, walk in walks(Path(folder)).items():
            walk()  # compiles, and fills the caches
            files = entered(walk)
            rooms = Counter(room_of(ROOT / file) for file in files)
            print(f"{name:36}{len(files):5} files: " + ", ".join(f"{r} {n}" for r, n in rooms.most_common()))
            if listed:
                print(*(f"    {file}" for file in sorted(files)), sep="\n")


# ---- lines and circles


def show_lines() -> None:
    lines, files = Counter(), Counter()
    for path in sources():
        lines[room_of(path)] += len(path.read_text(encoding="utf-8").splitlines())
        files[room_of(path)] += 1
    for name in sorted(lines):
        print(f"{name:24}{lines[name]:8}{files[name]:6}")
    small = sum(len(path.read_text(encoding="utf-8").splitlines()) < 60 for path in sources())
    print(f"{'all':24}{lines.total():8}{files.total():6}   ({small} files under 60 lines)")


def architecture() -> ModuleType:
    """The test that declares the floors and reads the imports."""
    sys.path.append(str(ROOT / "tests"))
    return import_module("test_architecture")


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that reach each other."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    names = sorted(graph)
    reaches = csr_array([[below in graph[name] for below in names] for name in names])
    count, group_of = connected_components(reaches, connection="strong")
    groups = [[name for name, k in zip(names, group_of, strict=True) if k == group] for group in range(count)]
    return [group for group in groups if len(group) > 1]


def show_circles() -> None:
    for package in map(import_module, PACKAGES):
        graph = architecture().arrows(package)
        groups = circles({name: below for name, below in graph.items() if name != package.__name__})
        print(f"{package.__name__}: {len(groups)} circle(s)")
        for group in groups:
            print("   ", ", ".join(group))


# ---- the tables of rooms in docs/house.md


def room_table(package: str) -> str:
    """The rooms of a package with the first paragraph of their docstrings, as Markdown."""
    rows = [f"| room of `{package}` | what is in it |", "| :-- | :-- |"]
    for name in (room for floor in architecture().FLOORS[package] for room in floor):
        place = ROOT / package / name
        source = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
        text = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
        rows.append(f"| `{name}` | {' '.join(text.split(chr(10) * 2)[0].split()).rstrip('.')} |")
    return "\n".join(rows)


def page_with_rooms(page: str) -> str:
    """docs/house.md with its tables of rooms made anew."""
    for package in PACKAGES:
        pattern = rf"^\| room of `{package}` \|.*?(?=\n\n)"
        page = re.sub(pattern, lambda _, name=package: room_table(name), page, flags=re.DOTALL | re.MULTILINE)
    return page


def write_rooms() -> None:
    path = ROOT / "docs" / "house.md"
    path.write_text(page_with_rooms(path.read_text(encoding="utf-8")), encoding="utf-8")


# ---- names


def kind_of(name: str) -> str:
    """The kind of a name that says nothing; empty for a good one."""
    words = re.findall(r"[A-Z]?[a-z]+|[A-Z]+|\d+", name)
    kinds = [KIND_OF.get(word) or _participle(word) for word in map(str.lower, words)]
    return kinds[-1] if kinds and all(kinds) else ""


def _participle(word: str) -> str:
    return "participle" if re.fullmatch(r"[a-z]{2,}ed", word) and word not in NOUNS_IN_ED else ""


def _is_flag(value: ast.expr | None) -> bool:
    """Whether a value is a truth value as it is written."""
    if isinstance(value, ast.BoolOp):
        return all(_is_flag(each) for each in value.values)
    if isinstance(value, ast.Call):
        return isinstance(value.func, ast.Name) and value.func.id in ("bool", "any", "all", "isinstance")
    if isinstance(value, ast.Constant):
        return isinstance(value.value, bool)
    return isinstance(value, ast.Compare) or (isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not))


def local_names(function: ast.AST) -> set[str]:
    """Names of arguments and of what is assigned in a function, flags left out."""
    names, flags = set(), set()
    for node in ast.walk(function):
        if isinstance(node, ast.arg):
            (flags if isinstance(node.annotation, ast.Name) and node.annotation.id == "bool" else names).add(node.arg)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Assign) and _is_flag(node.value):
            flags |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return names - flags


def names_in(path: Path) -> Iterator[tuple[str, str, int]]:
    """What is named (module, function, class, local), the name and its line; of nested functions once."""
    if path.stem != "__init__":
        yield "module", path.stem, 1
    nested: set[ast.AST] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef):
            yield "class", node.name, node.lineno
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            flag = isinstance(node.returns, ast.Name) and node.returns.id == "bool"
            if not flag and not any(isinstance(d, ast.Name) and d.id == "property" for d in node.decorator_list):
                yield "function", node.name, node.lineno
            if node not in nested:
                for name in sorted(local_names(node)):
                    yield "local", name, node.lineno
            nested |= {n for n in ast.walk(node) if isinstance(n, (ast.FunctionDef, ast.AsyncFunctionDef))}


def show_names(folder: str, listed: bool) -> None:
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    total, worst = Counter(), Counter()
    for path in sources(folder):
        for what, name, line in names_in(path):
            total[what] += 1
            if kind := kind_of(name):
                counts[what][kind] += 1
                worst[name] += 1
                if listed:
                    print(f"{path.relative_to(ROOT)}:{line}: {what} {name} ({kind})")
    for what in ("module", "class", "function", "local"):
        kinds = ", ".join(f"{kind} {n}" for kind, n in counts[what].most_common())
        print(f"{what:10}{counts[what].total():6} of {total[what]:6}   {kinds}")
    print("most frequent:", ", ".join(f"{name} {n}" for name, n in worst.most_common(40)))


def main() -> None:
    sys.path.insert(0, str(ROOT))  # the walks enter the files beside this script, whatever is installed
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("walks", "lines", "circles", "rooms", "names"))
    parser.add_argument("folder", nargs="?", default="", help="names: of this folder alone, for example sysid/base")
    parser.add_argument("--list", action="store_true", help="walks: every file; names: every name")
    asked = parser.parse_args()
    if asked.what == "walks":
        show_walks(asked.list)
    elif asked.what == "names":
        show_names(asked.folder, asked.list)
    else:
        {"lines": show_lines, "circles": show_circles, "rooms": write_rooms}[asked.what]()


if __name__ == "__main__":
    main()
