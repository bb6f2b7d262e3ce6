"""A fit as readable JSON: its values by the fields and type hints of dataclasses, changes between versions, its file.

A field added to `Fit` or to a block needs no change here. The file includes derived criteria for its reader.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Strict, ValidationError, create_model
from pydantic import Field as Entry

from sysid.base.errors import InputError, unknown
from sysid.base.files import json_text, write_text
from sysid.block.block import Block
from sysid.blocks import TABLE

T = TypeVar("T")
FORMAT = "sysid fit"
_WIDTH = 110
Names = Mapping[str, str]  # old name -> new name


def encode(value: Any, place: str) -> Any:
    """Lists, dicts, numbers and strings; numbers that JSON does not know become 'inf', '-inf', 'nan'.

    Raises InputError, with the name `place`, for a value that cannot be written as text.
    """
    if is_dataclass(value) and not isinstance(value, type):
        plain = {f.name: encode(getattr(value, f.name), f"{place}, {f.name}") for f in fields(value) if f.init}
        return {"kind": _kind(value, place), **plain} if isinstance(value, Block) else plain
    if isinstance(value, Mapping):
        return {str(k): encode(v, f"{place}, {k}") for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return encode(value.tolist(), place)
    if isinstance(value, (list, tuple)):
        return [encode(v, place) for v in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else str(float(value))
    if value is None or isinstance(value, str):
        return value
    raise InputError(
        f"{place} is a {type(value).__name__}, which a text file cannot store; use a piecewise linear map or a spline "
        "instead of a custom function"
    )


def build(kind: type[T], values: Any) -> T:
    """The dataclass from the output of `encode`; raises InputError if a value is missing, wrong or unknown."""
    if not isinstance(values, dict):
        raise InputError(f"this should be a table of {', '.join(f.name for f in fields(kind))}")  # type: ignore[arg-type]
    try:
        entries = _schema(kind).model_validate(values)  # type: ignore[arg-type]
    except ValidationError as e:
        raise InputError(_sentence(e)) from None
    return kind(**{f.name: getattr(entries, f.name) for f in fields(kind) if f.init})  # type: ignore[arg-type]


def lines(value: Any, indent: int = 0) -> str:
    """JSON laid out for reading: values that fit on a line, and all rows of numbers, are on one line."""
    flat = json_text(value)
    entries = list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else []
    row = isinstance(value, list) and not any(isinstance(v, (dict, list, str)) for v in value)
    if not entries or row or len(flat) + 2 * indent <= _WIDTH:
        return flat
    pad, close = "  " * (indent + 1), "  " * indent
    if isinstance(value, dict):
        rows = [f"{pad}{json_text(k)}: {lines(v, indent + 1)}" for k, v in value.items()]
        return "{\n" + ",\n".join(rows) + f"\n{close}}}"
    return "[\n" + ",\n".join(f"{pad}{lines(v, indent + 1)}" for v in value) + f"\n{close}]"


def _kind(block: Block, place: str) -> str:
    for name, block_type in TABLE.items():
        if block_type is type(block):
            return name
    raise InputError(f"{place} is a {type(block).__name__}, not a block of sysid.blocks; it cannot be saved")


def _block(values: Any) -> Block:
    if not isinstance(values, dict) or not isinstance(values.get("kind"), str):
        raise InputError(f"a block is a table with its kind; known kinds are {', '.join(TABLE)}")
    if values["kind"] not in TABLE:
        raise unknown("block", values["kind"], TABLE)
    return build(TABLE[values["kind"]], {k: v for k, v in values.items() if k != "kind"})  # type: ignore[arg-type]


def _number(value: Any) -> Any:
    """The inverse of `encode` for numbers that JSON does not know."""
    return float(value) if value in ("inf", "-inf", "nan") else value


def _loose(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _loose(v) for k, v in value.items()}
    return [_loose(v) for v in value] if isinstance(value, list) else _number(value)


def _array(value: Any) -> np.ndarray:
    """The array of a list of numbers; raises InputError for anything else."""
    if not isinstance(value, list):
        raise InputError("this should be a list of numbers")
    try:
        array = np.array(_loose(value))
    except ValueError:
        raise InputError("the rows of this table have different lengths") from None
    if array.dtype.kind not in "bif":
        raise InputError("this list has an entry that is not a number")
    return array if array.size else array.astype(float)


_STRICT: dict[Any, Any] = {float: Annotated[float, Strict(), BeforeValidator(_number)], int: Annotated[int, Strict()]}
_STRICT |= {bool: Annotated[bool, Strict()], str: Annotated[str, Strict()], NoneType: NoneType}


def _annotation(hint: Any) -> Any:
    """The type hint of a field in the form that pydantic reads from JSON."""
    if hint in _STRICT:
        return _STRICT[hint]
    if hint is Any:
        return Annotated[Any, BeforeValidator(_loose)]
    if hint is np.ndarray:
        return Annotated[Any, BeforeValidator(_array)]
    if isinstance(hint, type) and issubclass(hint, Block):
        return Annotated[Any, BeforeValidator(_block)]
    if isinstance(hint, type) and is_dataclass(hint):
        return Annotated[Any, BeforeValidator(_builder(hint))]
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return Union[tuple(_annotation(a) for a in args)]  # noqa: UP007 - made at run time
    if origin is tuple:
        return tuple[tuple(a if a is Ellipsis else _annotation(a) for a in args)]  # type: ignore[misc]
    if origin is not None and isinstance(origin, type) and issubclass(origin, Mapping):
        return dict[_annotation(args[0]), _annotation(args[1])]  # type: ignore[misc]
    return Annotated[Any, BeforeValidator(_refuse_text)]


def _builder(kind: type) -> Callable[[Any], Any]:
    return lambda values: build(kind, values)


def _refuse_text(value: Any) -> Any:
    """Only None is allowed where the hint is a function."""
    if value is not None:
        raise InputError("this cannot be read from text")
    return value


@cache
def _schema(kind: type) -> type[BaseModel]:
    hints = get_type_hints(kind)
    entries: dict[str, Any] = {f.name: (_annotation(hints[f.name]), _default(f)) for f in fields(kind) if f.init}
    return create_model(kind.__name__, __config__=ConfigDict(extra="forbid", arbitrary_types_allowed=True), **entries)


def _default(f: Field) -> Any:
    if f.default_factory is not MISSING:
        return Entry(default_factory=f.default_factory)
    return ... if f.default is MISSING else f.default


def _sentence(error: ValidationError) -> str:
    """The first error and its place."""
    first = error.errors(include_url=False)[0]
    place = " ".join(str(p) for p in first["loc"])
    if first["type"] == "missing":
        return f"{place} is missing; the file is not complete"
    if first["type"] == "extra_forbidden":
        return f"{place} is not known to this version of the library; update it, or remove the entry"
    text = str(first["ctx"]["error"]) if "error" in first.get("ctx", {}) else first["msg"]
    return f"{place}: {text[0].lower()}{text[1:]}" if text else place


@dataclass(frozen=True)
class Step:
    """From one version of the file to the next. Renames need a line here and no code; `then` does other changes.

    kinds: kinds of block. fields: the options of a kind of block (by its new name), of 'fit' or of 'model'. parameters:
    the slots of a kind of block, in all parameter names. then: a change of the whole document, after the renames.
    """

    kinds: Names = field(default_factory=dict)
    fields: Mapping[str, Names] = field(default_factory=dict)
    parameters: Mapping[str, Names] = field(default_factory=dict)
    then: Callable[[dict[str, Any]], dict[str, Any]] | None = None

    def apply(self, document: dict[str, Any]) -> dict[str, Any]:
        """The document of this version converted to the next. Unknown parts stay unchanged for the loader."""
        converted = _rename_keys({k: self._blocks(v) for k, v in document.items()}, self.fields.get("fit", {}))
        model = converted.get("model")
        if isinstance(model, dict):
            model = _rename_keys(model, self.fields.get("model", {}))
            converted["model"] = model
            names = self._by_parameter(model.get("blocks"), converted.get("theta"))
            for table, key in ((converted, "theta"), (model, "fixed"), (model, "bounds")):
                if isinstance(table.get(key), dict):
                    table[key] = _rename_keys(table[key], names)
        return self.then(converted) if self.then is not None else converted

    def _blocks(self, value: Any) -> Any:
        """The same with every block in it, at any depth, under its new kind and with its new options."""
        if isinstance(value, list):
            return [self._blocks(v) for v in value]
        if not isinstance(value, dict):
            return value
        converted = {k: self._blocks(v) for k, v in value.items()}
        if isinstance(converted.get("kind"), str):
            converted["kind"] = self.kinds.get(converted["kind"], converted["kind"])
            converted = _rename_keys(converted, self.fields.get(converted["kind"], {}))
        return converted

    def _by_parameter(self, blocks: Any, theta: Any) -> Names:
        """Full names of renamed parameters: 'role.old', of channels 'role.1.old'."""
        names = {}
        for block in (b for b in blocks if isinstance(b, dict)) if isinstance(blocks, list) else ():
            slots = {old: new for kind in _kinds(block) for old, new in self.parameters.get(kind, {}).items()}
            for name in theta if isinstance(theta, dict) else []:
                front, _, slot = name.rpartition(".")
                if slot in slots and (front + ".").startswith(f"{block.get('role')}."):
                    names[name] = f"{front}.{slots[slot]}"
        return names


def _rename_keys(table: dict[str, Any], names: Names) -> dict[str, Any]:
    return {names.get(k, k): v for k, v in table.items()}


def _kinds(value: Any) -> set[str]:
    """Kinds of block in a value, at any depth."""
    if isinstance(value, list):
        return {kind for v in value for kind in _kinds(v)}
    if not isinstance(value, dict):
        return set()
    outer = {value["kind"]} if isinstance(value.get("kind"), str) else set()
    return outer | {kind for v in value.values() for kind in _kinds(v)}


# Step k takes version k + 1 to version k + 2; a file goes through all that are newer than it is.
STEPS: tuple[Step, ...] = (
    # Version 1 wrote the loss as mse, which is correct for plain least squares only. It did not store the cost, so its
    # mse is kept; for fits with weights or a robust loss it stays the loss, and so do the criteria that follow from
    # it.
    Step(),
    # Version 2 did not store the offsets that were removed from the estimation data, nor its names, units, fit
    # and noise. They stay unknown (None), and the fit takes every record as it is.
    Step(),
)
VERSION = len(STEPS) + 1


def migrate(document: dict[str, Any], version: int) -> dict[str, Any]:
    """The document of a file of this version in today's form."""
    for step in STEPS[version - 1 :]:
        document = step.apply(document)
    return document


def save(fit: Any, path: str | os.PathLike) -> Path:
    """Write a `sysid.Fit`; raises InputError for a model that text cannot store or a path that cannot be written."""
    return write(fit, fit.model.names, {"format": FORMAT, "version": VERSION}, path)


def write(fit: Any, names: Sequence[str], head: Mapping[str, Any], path: str | os.PathLike) -> Path:
    """Write a fit behind a `head`, with the `names` of its parameters."""
    document = {**head, **encode(fit, "the fit")}
    document["criteria"] = encode(fit.criteria.as_dict(), "the fit, criteria")
    document["theta"] = dict(zip(names, document["theta"], strict=True))
    return write_text(path, lines(document) + "\n")
