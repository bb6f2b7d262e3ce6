"""The pages of docs/: each is on the site, its links lead somewhere, its commands exist and its code runs.

The site itself is built by `sh scripts/docs`, which .ci/run calls; here is what can be said quickly and without Sphinx.
"""

import json
import re
import runpy
import shlex
import sys
from functools import cache
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import typer
from often import FULL
from typer.exceptions import TyperException

from twin.cli import main
from twin.cli.app import build

pytestmark = pytest.mark.pixels

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(path.name for path in DOCS.glob("*.md"))
MOVED = "search.md"  # not on the site
WRITTEN = [DOCS / page for page in PAGES] + [ROOT / "CONTRIBUTING.md", ROOT / "README.md"]

# Commands that a test would wait for too long, by page and block; they are parsed like all others.
NOT_RUN = {
    ("benchmark-method.md", 0): "tests/docs/test_benchmark_method.py runs them on fewer scenarios",
    ("benchmark-method.md", 1): "the same",
    ("benchmark-method.md", 2): "the same",
    ("benchmark.md", 0): "runs of a whole tag; tests/cli/test_bench.py and .ci/nightly run them",
    ("calibrate.md", 0): "minutes, and logs of a rig; tests/recovery/test_calibrate.py",
    ("calibrate.md", 1): "minutes, and logs of three days; tests/recovery/test_calibrate_runs.py",
    ("calibrate.md", 2): "the reader's own robot; tests/recovery/test_mjcf.py",
    ("certify.md", 1): "all records, and the reader's own method; tests/cli/test_bench_certify.py",
    ("compare.md", 0): "a minute, and logs of a rig; tests/cli/test_compare.py",
    ("compare.md", 1): "the reader's own robot; tests/recovery/test_mjcf_compare.py",
    ("index.md", 0): "the commands of the tutorial",
    ("joint.md", 0): "an experiment of ten minutes is identified; tests/cli/test_design.py on a short one",
    ("joint.md", 1): "another input, and the record of the experiment; tests/recovery/test_design_for_use.py",
    ("logs.md", 0): "the reader's own log; tests/cli/test_info_file.py",
    ("record.md", 0): "the commands of the tutorial on another joint",
    ("record.md", 1): "an experiment of minutes is designed; tests/cli/test_design.py",
    ("record.md", 2): "and identified",
    ("rig.md", 0): "installs the extra",
    ("rig.md", 2): "minutes; tests/cli/test_rig.py",
    ("rig.md", 3): "a compiler; tests/rig/test_flash.py",
    ("rig.md", 5): "a rig; tests/cli/test_rig.py on an emulated one",
    ("rig.md", 6): "the same",
    ("rig.md", 7): "installs the extra",
    ("rig.md", 9): "a servo; tests/rig/test_servo_bus.py on an emulated one",
    ("structure.md", 0): "a search within a minute; tests/docs/test_readme.py runs one",
}
LESS = {"--duration": 60.0, "--starts": 1.0}  # enough to show that a command runs
WHOLE = ("tutorial.md",) if FULL else ()  # its text has numbers; every run has those of its Python


def text(page: str) -> str:
    return (DOCS / page).read_text(encoding="utf-8")


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text(page), flags=re.DOTALL | re.MULTILINE)


def prose(source: str) -> str:
    """A page without its blocks of code."""
    return re.sub(r"^```.*?^```", "", source, flags=re.DOTALL | re.MULTILINE)


def commands(block: str) -> list[list[str]]:
    return [line for line in (shlex.split(row, comments=True) for row in block.splitlines()) if line]


@cache
def anchors(path: Path) -> set[str]:
    """Names of a page's headings in links, as GitHub and the site make them."""
    found = re.findall(r"^#+ (.*)$", prose(path.read_text(encoding="utf-8")), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in found}


def test_every_page_is_in_a_list_of_the_first_page():
    listed = "\n".join(re.findall(r"^```\{toctree\}\n(.*?)^```", text("index.md"), flags=re.DOTALL | re.MULTILINE))
    names = [line for line in listed.splitlines() if line and not line.startswith((":", "generated/"))]
    assert len(names) == len(set(names))
    patterns = [re.compile(re.escape(name).replace(r"\*", ".*") + r"\.md") for name in names]
    assert [p for p in PAGES if p not in ("index.md", MOVED) and not any(q.fullmatch(p) for q in patterns)] == []
    assert [name for name in names if "*" not in name and not (DOCS / f"{name}.md").is_file()] == []


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(path.read_text(encoding="utf-8"))):
        if re.match(r"https?://", target):
            continue
        name, _, anchor = target.partition("#")
        there = (path.parent / name).resolve() if name else path
        assert there.is_file(), target
        assert not anchor or anchor in anchors(there), target


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.name)
def test_scripts_and_tests_that_are_named_exist(path):
    named = re.findall(r"\b((?:scripts|tests)/[\w/]+(?:\.\w+)?)", path.read_text(encoding="utf-8"))
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.name)
def test_every_command_is_one(path):
    source = path.read_text(encoding="utf-8")
    shell = re.findall(r"^```sh\n(.*?)^```", source, flags=re.DOTALL | re.MULTILINE)
    for program, *arguments in commands("\n".join(shell + re.findall(r"^    (qpal .*)$", source, flags=re.MULTILINE))):
        if program == "qpal":
            parse(arguments)


def parse(arguments: list[str]) -> None:
    """Raises the command line's own error for a verb or an option that does not exist; runs nothing."""
    command = typer.main.get_command(build())
    name, *rest = arguments
    command = command.commands[name]
    if hasattr(command, "commands"):
        name, *rest = rest
        command = command.commands[name]
    command.make_context(name, rest)


def test_a_stale_option_would_be_seen():
    parse(["identify", "thigh.csv", "--structure", "auto"])
    with pytest.raises(TyperException, match="--model"):
        parse(["identify", "thigh.csv", "--model", "auto"])


def test_what_is_not_run_exists():
    assert [(page, k) for page, k in NOT_RUN if page not in PAGES or k >= len(blocks(page, "sh"))] == []
    for reason in NOT_RUN.values():
        assert all((ROOT / name).is_file() for name in re.findall(r"tests/[\w/]+\.py", reason)), reason


def run(arguments: list[str], page: str) -> None:
    if page not in WHOLE:
        pairs = zip([None, *arguments[:-1]], arguments, strict=True)
        arguments = [f"{min(float(each), LESS[option]):g}" if option in LESS else each for option, each in pairs]
    assert main(arguments) == 0, arguments


@pytest.mark.long
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(p, marks=[pytest.mark.nightly] * (p == "tutorial.md"))
        for p in PAGES
        if any((p, k) not in NOT_RUN for k, _ in enumerate(blocks(p, "sh")))
    ],
)
def test_commands_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if page == "rig.md":  # whose Python writes the goals that a command plays
        python_of(page, tmp_path, monkeypatch)
    for k, block in enumerate(blocks(page, "sh")):
        for program, *arguments in commands(block) if (page, k) not in NOT_RUN else ():
            if program == "qpal":
                run(arguments, page)
    if page in WHOLE:
        fits = {name: json.loads(Path(name, "summary.json").read_text())["fit_percent"] for name in ("first", "joint")}
        assert 80.0 < fits["first"]["estimation"] < 95.0
        assert fits["first"]["validation"] < 70.0
        assert min(fits["joint"].values()) > 98.0


def own_test(page: str) -> Path:
    return Path(__file__).with_name(f"test_{Path(page).stem.replace('-', '_')}.py")


def python_of(page: str, folder: Path, patch: pytest.MonkeyPatch) -> dict:
    """What the blocks of a page leave behind, run one after the other in an empty folder."""
    patch.chdir(folder)
    Path("page.py").write_text("\n".join(blocks(page, "python")), encoding="utf-8")
    try:
        return runpy.run_path("page.py")
    finally:
        plt.close("all")


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "python") and not own_test(p).exists()])
def test_python_runs(page, tmp_path, monkeypatch):
    left = python_of(page, tmp_path, monkeypatch)
    check = {"intervals.md": intervals_are_those_of_the_table, "tutorial.md": the_joint_wins, "add-a-block.md": found}
    check["export.md"] = the_unit_is_the_model
    check.get(page, lambda left: None)(left)


def intervals_are_those_of_the_table(left: dict) -> None:
    rows = re.findall(
        r"^\| (plain|tested)[^|]*\| (\d+) of 60 \| (\d+) of 60 \|$", text("intervals.md"), flags=re.MULTILINE
    )
    shown = {(colour, kind): int(n) for kind, *counts in rows for colour, n in zip((0.0, 0.9), counts, strict=True)}
    assert len(shown) == 4
    # Another processor may round an interval to the other side of the pole.
    assert left["counts"] == pytest.approx(shown, abs=1)


def the_joint_wins(left: dict) -> None:
    fits = {name: left[name].fit_percent(left["validation"]) for name in ("first", "joint")}
    assert fits["joint"] > 98.0 > fits["first"] + 20.0
    assert Path("first-fit.png").stat().st_size > 10_000


def the_unit_is_the_model(left: dict) -> None:
    expected = left["fit"].simulate(left["u"])
    np.testing.assert_array_equal(left["run"]["y"], expected)
    assert np.abs(left["changed"]["y"] - expected).max() > 0.1
    np.testing.assert_array_equal(left["whole"][:, 0], expected)
    np.testing.assert_array_equal(np.concatenate([left["begin"], left["end"]]), left["whole"])


def found(left: dict) -> None:
    values = {p.name: p.value for p in left["fit"].parameters}
    assert values["input.grade"] == pytest.approx(2.0, rel=0.1)
    assert values["linear.f1"] == pytest.approx(-0.7, abs=0.03)


@pytest.fixture(scope="module")
def site():
    """The modules that make pages from the code."""
    sys.path.insert(0, str(DOCS / "_site"))
    try:
        import reference

        yield reference
    finally:
        sys.path.remove(str(DOCS / "_site"))


def test_the_page_of_commands_has_every_option(site):
    page = " ".join(site.command_page().replace("\\", "").replace("``", "`").split())
    command = typer.main.get_command(build())
    for verb in command.commands.values():
        for each in getattr(verb, "commands", {"": verb}).values():
            for parameter in each.params:
                if parameter.name != "help" and parameter.opts[0].startswith("--"):
                    assert f"`{parameter.opts[0]}" in page or f", {parameter.opts[0]}" in page, parameter.opts
                    assert " ".join(parameter.help.replace("`", "").split()) in page.replace("`", ""), parameter.help


def test_every_verb_says_how_long_it_may_take(site):
    """A new one too; the options that it names exist."""
    group = typer.main.get_command(build())
    found = dict(site.limits(group))
    rig = [f"rig {name}" for name in group.commands["rig"].commands]
    assert sorted(found) == sorted([*(group.commands.keys() - {"bench", "rig"}), "bench run", *rig])
    page = site.command_page().replace("\\", "").replace("``", "`")
    for verb, said in found.items():
        assert f"   * - ``{verb}``\n".replace("``", "`") + "".join(f"     - {cell}\n" for cell in said) in page
        name, _, inner = verb.partition(" ")
        command = group.commands[name].commands[inner] if inner else group.commands[name]
        for option in re.findall(r"--[a-z]+", said[2]):
            assert option in [name for parameter in command.params for name in parameter.opts], (verb, option)


@pytest.mark.parametrize("package", ["sysid", "twin"])
def test_the_reference_has_every_public_name(site, package):
    rooms, names = site.public(package)
    page = site.package_page(package)
    assert len(names) > 8
    for name in names:
        assert re.search(rf"^\.\. auto(class|function|data):: {package}\.{name}$", page, flags=re.MULTILINE), name
    for room in rooms:
        assert f"\n   {package}.{room}\n" in page
        assert site.module_page(package, room).startswith(f"{package}.{room}\n===")


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("`x` and |r_e(k)|", "``x`` and \\|r_e(k)\\|"),
        ("2 * 3, y_ and r_e", "2 \\* 3, y\\_ and r_e"),
        ("`a * b`", "``a * b``"),
    ],
)
def test_docstrings_keep_their_signs(site, said, shown):
    assert site.restructured(said) == shown


def test_citation_has_the_version_of_the_package():
    cff = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    (version,) = re.findall(r'^version = "(.*)"$', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), flags=re.M)
    assert re.search(rf"^version: {re.escape(version)}$", cff, flags=re.MULTILINE)
    for key in ("cff-version: 1.2.0", "message:", "title:", "authors:", "license: Apache-2.0", "type: software"):
        assert re.search(rf"^{re.escape(key)}", cff, flags=re.MULTILINE), key
