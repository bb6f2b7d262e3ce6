"""Method files of other people: a first one to edit, and what a file says about itself."""

import ast
import importlib.util
import keyword
from collections.abc import Collection
from pathlib import Path
from typing import Any

from sysid.base.errors import InputError
from sysid.base.files import read_limited, write_text
from sysid.bench.isolation import FileMethod

MOST = 2**22  # [byte] of a method file, more than anybody writes
TEMPLATE = Path(__file__).with_name("template.py")


def add(name: str, folder: str | Path = ".", methods: Collection[str] = ()) -> Path:
    """Write the method file `name`.py, which runs as it is, into a folder.

    Raises InputError for a name that is no Python name, that one of `methods` or a module has, and for a file that is
    there already.
    """
    if not name.isidentifier() or keyword.iskeyword(name):
        raise InputError(f"{name!r} is no name for a method; use letters, digits and _, for example my_arx")
    path = Path(folder) / f"{name}.py"
    if path.exists():
        raise InputError(f"{path} exists already; choose another name, or edit it: qpal bench run --method {path}")
    if name in methods or name in ("own", "peers") or importlib.util.find_spec(name) is not None:
        raise InputError(f"{name} is the name of a method or module that is there; choose another, such as my_{name}")
    return write_text(path, TEMPLATE.read_text(encoding="utf-8"))


def load(path: str | Path) -> FileMethod:
    """The method of a file, which is read and not run. Its name is that of the file.

    Raises InputError if the file is not there, is no Python, has no `fit` of one argument, imports sysid, or gives
    REQUIREMENTS, PIP_OPTIONS or PACKAGE in another form than plain strings.
    """
    file = Path(path)
    if file.suffix != ".py" or not file.is_file():
        raise InputError(f"there is no method file {file}; write one with qpal bench add {file.stem or 'my_arx'}")
    try:
        tree = ast.parse(read_limited(file, MOST).decode("utf-8"))
    except SyntaxError as error:
        raise InputError(f"{file}, line {error.lineno}: {error.msg}; correct it and run again") from None
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}); give a file that you may read") from None
    except (ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"{file} is no Python text ({error}); give a file written by qpal bench add") from None
    _check_fit(tree, file)
    _check_imports(tree, file)
    requirements, options = (_strings(tree, name, file) for name in ("REQUIREMENTS", "PIP_OPTIONS"))
    first = _package_of(requirements[0]) if requirements else ""
    package = _constant(tree, "PACKAGE", first)
    if not isinstance(package, str):
        raise InputError(f"PACKAGE in {file} is {package!r}; give the name of one package as a string")
    summary = (ast.get_docstring(tree) or "").split("\n")[0].rstrip(".")
    return FileMethod(file.stem, summary, str(file.resolve()), requirements, package, options)


def _check_fit(tree: ast.Module, file: Path) -> None:
    """Raises InputError unless there is a function `fit` that one argument suffices for."""
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "fit"]
    if not functions:
        raise InputError(f"{file} has no function fit(data); see a file that has: qpal bench add my_arx")
    arguments = functions[-1].args
    positional = len(arguments.posonlyargs) + len(arguments.args) - len(arguments.defaults)
    keywords = sum(default is None for default in arguments.kw_defaults)
    if positional > 1 or keywords or not (arguments.posonlyargs or arguments.args or arguments.vararg):
        raise InputError(f"fit in {file} takes other arguments; it gets one, the data: def fit(data)")


def _check_imports(tree: ast.Module, file: Path) -> None:
    """Raises InputError for an import of this library, which the environment of the method does not have."""
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
            except (ValueError, TypeError, SyntaxError, RecursionError, MemoryError):
                return None
    return default


def _strings(tree: ast.Module, name: str, file: Path) -> tuple[str, ...]:
    values = _constant(tree, name, [])
    if not isinstance(values, (list, tuple)) or not all(isinstance(value, str) for value in values):
        raise InputError(f'{name} in {file} must be a plain list of strings, for example {name} = ["scipy>=1.13"]')
    return tuple(values)


def _package_of(requirement: str) -> str:
    """sysidentpy of 'sysidentpy[all]>=0.5 ; python_version > "3"'."""
    end = next((k for k, c in enumerate(requirement) if not (c.isalnum() or c in "-_.")), len(requirement))
    return requirement[:end]
