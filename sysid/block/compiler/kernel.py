"""Compiled kernels of a step: their source, and its folder, which numba needs for its cache."""

import hashlib
import os
import re
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import CodeType, ModuleType

from sysid.base.locks import sweep_once, temporary_name
from sysid.block.compiler.activity import delays, hoist_constants, memoryless
from sysid.block.compiler.derive import show, variable
from sysid.block.compiler.functions import KERNEL
from sysid.block.compiler.ir import Assign, Body, Break, For, If, Program, Return

_END = "\n# whole: "  # and a checksum of what stands above
_HEAD = '''"""Written by sysid.block.compiler from the step of {name}; made again where it is missing."""

from math import inf

import numpy as np
from numba import njit

from sysid.base.compiled import kernel

{functions}
PARAMETERS = {params}
ROWS = {rows}
STRUCTURE = {consts}
MEMORYLESS = {memoryless}  # the tangent then also gives the slope

'''


def kernels(
    name: str, key: str, program: Callable[[], Program], absent: Mapping[str, float], near: Path | None
) -> ModuleType:
    """The module with `value` and `tangent` of a step; it is written first if no folder has it.

    `key` changes with the step; `program` reads the step and is called only if the file is missing; `near` is the
    folder of the block's file. If no folder is writable, each process compiles the module again.
    """
    digest = hashlib.blake2b(f"{key} {sorted(absent.items())} {_version()}".encode(), digest_size=8).hexdigest()
    stem = f"{re.sub(r'[^A-Za-z0-9]', '_', name)}_{digest}"
    full = f"sysid_compiled_{stem}"
    if full in sys.modules:
        return sys.modules[full]
    for folder in _folders(near):
        path = folder / f"{stem}.kernel"  # Python, but not a module of this package
        if _complete(path) or _written(path, lambda: source(name, program(), absent)):
            loader = _Source(full, str(path))
            module = module_from_spec(spec_from_loader(full, loader))  # type: ignore[arg-type]
            loader.exec_module(module)
            sys.modules[full] = module
            return module
    module = ModuleType(full)
    text = source(name, program(), absent)
    exec(compile(text, full, "exec"), module.__dict__)  # our own text, of a program that the subset has checked
    sys.modules[full] = module
    return module


class _Source(SourceFileLoader):
    """A module from a file whose text has been checked. Bytecode beside it could be damaged, so that none is used."""

    def get_code(self, fullname: str) -> CodeType:
        return self.source_to_code(self.get_data(self.path), self.path)


@cache
def _version() -> str:
    """Changes with the compiler itself."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.blake2b(b"".join(f.read_bytes() for f in files), digest_size=8).hexdigest()


def _folders(near: Path | None) -> list[Path]:
    """Possible folders of kernels: beside the block's compiled module, then the user's cache."""
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    folders = [near / "__pycache__"] if near else []
    with suppress(RuntimeError):  # a user without a home
        folders.append((Path(home) if home else Path.home() / ".cache") / "sysid" / "kernels")
    return folders


def _complete(path: Path) -> bool:
    """Whether the file is there and whole; a damaged one is removed."""
    try:
        text, mark, digest = path.read_text(encoding="utf-8").rpartition(_END)
        if mark and digest == f"{_digest(text)}\n":
            return True
    except (OSError, UnicodeDecodeError):
        pass
    with suppress(OSError):
        path.unlink()
    return False


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def _written(path: Path, text: Callable[[], str]) -> bool:
    """Write a file that is always complete; a file that another process wrote first is kept."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep_once(path.parent)
        temporary = temporary_name(path, ".part")
        handle = os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
    except OSError:
        return False
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as f:
            f.write(text())
        with suppress(OSError):  # a file that is there, or a file system without links
            os.link(temporary, path)
        if not _complete(path):
            os.replace(temporary, path)
        return True
    except OSError:  # a full disk, or a folder of that name
        return False
    finally:
        temporary.unlink(missing_ok=True)


def source(name: str, program: Program, absent: Mapping[str, float]) -> str:
    """Text of the module of a program."""
    program = hoist_constants(program)
    head = _HEAD.format(
        name=name,
        functions=KERNEL,
        params=program.params,
        rows=program.rows,
        consts=program.consts,
        memoryless=memoryless(program),
    )
    text = head + _value(program, absent) + "\n\n" + _tangent(program, absent)
    return f"{text}{_END}{_digest(text)}\n"


def _arguments(program: Program) -> str:
    rows = [f"a_{r}, n_{r}" for r in program.rows]
    return ", ".join(["theta", "column", *(f"k_{c}" for c in program.consts), *rows])


def _parameters(program: Program, absent: Mapping[str, float]) -> list[str]:
    """Parameters by name; parameters that this block does not have get column -1."""
    lines = []
    for i, p in enumerate(program.params):
        other = f" if column[{i}] >= 0 else {float(absent[p])!r}" if p in absent else ""
        lines.append(f"    p_{p} = theta[column[{i}]]{other}")
    return lines


def _value(program: Program, absent: Mapping[str, float]) -> str:
    lines = [
        "@kernel(error_model='numpy')",
        f"def value({_arguments(program)}, x, y):",
        *_parameters(program, absent),
        *(f"    s_{s} = 0.0" for s in program.states),
        "    t = 0",
        "    u = x[0]",
        *_plain(program.begin, 1),
        *(
            line
            for n in delays(program)
            for line in (f"    if {show(n)} < 0:", "        y[:] = np.nan", "        return")
        ),
        "    for t in range(len(x)):",
        "        u = x[t]",
        *_plain(program.step, 2),
    ]
    return "\n".join(lines) + "\n"


def _plain(body: Body, depth: int) -> list[str]:
    """Statements as they are, without derivatives."""
    pad, lines = "    " * depth, []
    for s in body:
        if isinstance(s, Assign):
            value = show(s.value)
            lines.append(f"{pad}{variable(s.target)} = {value[1:-1] if _wrapped(value) else value}")
        elif isinstance(s, If):
            lines += [f"{pad}if {show(s.test)}:", *(_plain(s.body, depth + 1) or [f"{pad}    pass"])]
            if s.orelse:
                lines += [f"{pad}else:", *_plain(s.orelse, depth + 1)]
        elif isinstance(s, For):
            lines += [f"{pad}for v_{s.index} in range({show(s.count)}):", *_plain(s.body, depth + 1)]
        elif isinstance(s, Return):
            lines.append(f"{pad}y[t] = {show(s.value)}")
        elif isinstance(s, Break):
            lines.append(f"{pad}break")
    return lines


def _wrapped(text: str) -> bool:
    """Whether one pair of brackets holds the whole text."""
    depth = 0
    for i, c in enumerate(text):
        depth += (c == "(") - (c == ")")
        if depth == 0:
            return i == len(text) - 1 and text[0] == "("
    return False


def _tangent(program: Program, absent: Mapping[str, float]) -> str:
    from sysid.block.compiler.tangent import Writer

    w = Writer(program, frozenset(absent))
    w.depth = 1
    w.block(w.begin, w.states, frozenset())
    begin, w.lines, w.depth = w.lines, [], 2
    w.block(w.step, frozenset(), frozenset())
    buffer = ["for c in range(q):", "    dx[c] = J[t, c]"] if w.buffered else []
    lines = [
        "@kernel(error_model='numpy')",
        f"def tangent({_arguments(program)}, x, y, {'slope, ' if w.memoryless else ''}J, q):",
        "    n = q + len(theta)",
        *_parameters(program, absent),
        *(
            f"    c_{p} = q + column[{i}]" + (f" if column[{i}] >= 0 else -1" if p in absent else "")
            for i, p in enumerate(program.params)
        ),
        *(f"    s_{s} = 0.0" for s in program.states),
        *(f"    {v} = np.zeros(n + 1)" for v in sorted(w.vectors)),
        *(f"    {g} = 0.0" for g in sorted(w.numbers)),
        *(f"    {i} = 0" for i in w.places),
        *(["    dx = np.zeros(q)"] if w.buffered else []),
        *(["    W = J[:, :q].copy()"] if w.back else []),
        "    t = 0",
        "    u = x[0]",
        *(f"    {line}" for line in buffer),
        *begin,
        *(
            line
            for n in delays(program)
            for line in (f"    if {show(n)} < 0:", "        y[:], J[:, :n] = np.nan, np.nan", "        return")
        ),
        "    for t in range(len(x)):",
        "        u = x[t]",
        *(f"        {line}" for line in buffer),
        *w.lines,
    ]
    return "\n".join(lines) + "\n"
