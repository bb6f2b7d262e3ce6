"""Method files of other people: a first one to edit, and what a file says about itself."""

import ast
import importlib.util
import keyword
from pathlib import Path
from typing import Any

from sysid.base.errors import InputError
from sysid.base.files import write_text
from sysid.bench.outside import Outside

TEMPLATE = Path(__file__).with_name("template.py")


def add(name: str, folder: str | Path = ".") -> Path:
    """Write the method file `name`.py, which runs as it is, into a folder.

    Raises InputError for a name that is no Python name, and for a file that is there already.
    """
    from sysid.bench.methods import TABLE

    if not name.isidentifier() or keyword.iskeyword(name):
        raise InputError(f"{name!r} is no name for a method; use letters, digits and _, for example my_arx")
    path = Path(folder) / f"{name}.py"
    if path.exists():
        raise InputError(f"{path} exists already; choose another name, or edit it: qpal bench run --method {path}")
    if name in TABLE or name in ("own", "peers") or importlib.util.find_spec(name) is not None:
        raise InputError(f"{name} is the name of a method or module that is there; choose another, such as my_{name}")
    return write_text(path, TEMPLATE.read_text(encoding="utf-8"))


def load(path: str | Path) -> Outside:
    """The method of a file, which is read and not run. Its name is that of the file.

    Raises InputError if the file is not there, is no Python, has no `fit` of one argument, imports sysid, or gives
    REQUIREMENTS, PIP_OPTIONS or PACKAGE in another form than plain strings.
    """
    file = Path(path)
    if file.suffix != ".py" or not file.is_file():
        raise InputError(f"there is no method file {file}; write one with qpal bench add {file.stem or 'my_arx'}")
    try:
        tree = ast.parse(file.read_text(encoding="utf-8"))
    except SyntaxError as error:
        raise InputError(f"{file}, line {error.lineno}: {error.msg}; correct it and run again") from None
    except (UnicodeDecodeError, ValueError) as error:
        raise InputError(f"{file} is no Python text ({error}); give a file written by qpal bench add") from None
    _check_fit(tree, file)
    _check_imports(tree, file)
    requirements, options = (_strings(tree, name, file) for name in ("REQUIREMENTS", "PIP_OPTIONS"))
    first = _name_of(requirements[0]) if requirements else ""
    package = _constant(tree, "PACKAGE", first)
    if not isinstance(package, str):
        raise InputError(f"PACKAGE in {file} is {package!r}; give the name of one package as a string")
    about = (ast.get_docstring(tree) or "").split("\n")[0].rstrip(".")
    return Outside(file.stem, about, str(file.resolve()), requirements, package, options)


def _check_fit(tree: ast.Module, file: Path) -> None:
    """A function `fit` that one argument suffices for."""
    found = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "fit"]
    if not found:
        raise InputError(f"{file} has no function fit(data); see a file that has: qpal bench add my_arx")
    given = found[-1].args
    needed = len(given.posonlyargs) + len(given.args) - len(given.defaults)
    alone = sum(default is None for default in given.kw_defaults)
    if needed > 1 or alone or not (given.posonlyargs or given.args or given.vararg):
        raise InputError(f"fit in {file} takes other arguments; it gets one, the data: def fit(data)")


def _check_imports(tree: ast.Module, file: Path) -> None:
    """No import of this library: the environment of the method does not have it."""
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
        if any(name.split(".")[0] in ("sysid", "twin") for name in names):
            raise InputError(
                f"{file}, line {getattr(node, 'lineno', 0)} imports {names[0]}, which its environment does not have; "
                "write a method of sysid itself as a file in sysid/bench/methods"
            )


def _constant(tree: ast.Module, name: str, default: Any) -> Any:
    """The value that the file gives to a name at its top level; None if it is not written out."""
    for node in tree.body:
        if not isinstance(node, (ast.Assign, ast.AnnAssign)) or node.value is None:
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            try:
                return ast.literal_eval(node.value)
            except ValueError:
                return None
    return default


def _strings(tree: ast.Module, name: str, file: Path) -> tuple[str, ...]:
    found = _constant(tree, name, [])
    if not isinstance(found, (list, tuple)) or not all(isinstance(each, str) for each in found):
        raise InputError(f'{name} in {file} must be a plain list of strings, for example {name} = ["scipy>=1.13"]')
    return tuple(found)


def _name_of(requirement: str) -> str:
    """sysidentpy of 'sysidentpy[all]>=0.5 ; python_version > "3"'."""
    end = next((k for k, c in enumerate(requirement) if not (c.isalnum() or c in "-_.")), len(requirement))
    return requirement[:end]
