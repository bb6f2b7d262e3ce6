"""Damage: what disks, editors and hands do to bytes, to lines of text and to nested values."""

import copy
import re
from collections.abc import Callable
from typing import Any

import numpy as np

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
WORDS = (
    *("0", "-0.0", "1e308", "-1e308", "1e-320", "1e999", "1e160", "1e9", "1e18", "99999999999999999999", "2147483648"),
    *(
        "nan",
        "NaN",
        "inf",
        "-Infinity",
        "null",
        "None",
        "true",
        "",
        " ",
        "-",
        "--",
        "?",
        "x",
        "1_000",
        "0x1F",
        "1e",
        ".",
    ),
    *(
        "1,5",
        "1,234",
        "1.234,5",
        "1'000",
        "1 000",
        "\u0661",
        "\u22121",
        "1.#QNAN",
        '"',
        '""',
        "'",
        "1d3",
        "#N/A",
        "12:30:00",
    ),
)
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2, 7, 0.5, -0.5, 1e308, -1e308, 5e-324, 1e160, 1e-165, 1e9, 10**9, 2**31, 2**63),
    *(
        10**30,
        "",
        "x",
        "nan",
        "inf",
        "-inf",
        "1",
        "1e999",
        "\u0000",
        "../x",
        [],
        {},
        [1, 2],
        [[1.0], [2.0, 3.0]],
        [None],
    ),
    *({"a": 1}, {"kind": "nothing"}, [[[1]]], [1e308, 1e308], ["a", "b"], 1e-300, -7, 1000, 1e15),
)


def damaged(rng: np.random.Generator, content: bytes, most: int = 3) -> bytes:
    """The bytes after one to `most` faults."""
    for _ in range(rng.integers(1, most + 1)):
        content = BYTES[rng.integers(len(BYTES))](rng, content)
    return content


def _place(rng: np.random.Generator, content: bytes) -> int:
    return int(rng.integers(max(len(content), 1)))


def _flip(rng: np.random.Generator, content: bytes) -> bytes:
    if not content:
        return content
    k = _place(rng, content)
    return content[:k] + bytes([content[k] ^ (1 << int(rng.integers(8)))]) + content[k + 1 :]


def _other_byte(rng: np.random.Generator, content: bytes) -> bytes:
    k = _place(rng, content)
    return content[:k] + rng.bytes(1) + content[k + 1 :]


def _cut(rng: np.random.Generator, content: bytes) -> bytes:
    return content[: _place(rng, content)]


def _hole(rng: np.random.Generator, content: bytes) -> bytes:
    k = _place(rng, content)
    return content[:k] + content[k + int(rng.integers(1, 40)) :]


def _noise(rng: np.random.Generator, content: bytes) -> bytes:
    k = _place(rng, content)
    return content[:k] + rng.bytes(int(rng.integers(1, 9))) + content[k:]


def _zeros(rng: np.random.Generator, content: bytes) -> bytes:
    k, n = _place(rng, content), int(rng.integers(1, 33))
    return content[:k] + b"\0" * n + content[k + n :]


def _again(rng: np.random.Generator, content: bytes) -> bytes:
    k, n = _place(rng, content), int(rng.integers(1, 60))
    return content[: k + n] + content[k:]


def _line_again(rng: np.random.Generator, content: bytes) -> bytes:
    lines = content.splitlines(keepends=True) or [b""]
    k = int(rng.integers(len(lines)))
    return b"".join([*lines[: k + 1], *lines[k:]])


def _line_gone(rng: np.random.Generator, content: bytes) -> bytes:
    lines = content.splitlines(keepends=True) or [b""]
    k = int(rng.integers(len(lines)))
    return b"".join([*lines[:k], *lines[k + 1 :]])


def _lines_swapped(rng: np.random.Generator, content: bytes) -> bytes:
    lines = content.splitlines(keepends=True) or [b""]
    j, k = (int(x) for x in rng.integers(len(lines), size=2))
    lines[j], lines[k] = lines[k], lines[j]
    return b"".join(lines)


def _word(rng: np.random.Generator, content: bytes) -> bytes:
    """An odd word for one of the numbers."""
    found = list(NUMBER.finditer(content[:200_000]))
    if not found:
        return _noise(rng, content)
    match = found[int(rng.integers(len(found)))]
    return content[: match.start()] + WORDS[rng.integers(len(WORDS))].encode() + content[match.end() :]


BYTES: tuple[Callable[[np.random.Generator, bytes], bytes], ...] = (
    *(
        _flip,
        _other_byte,
        _cut,
        _hole,
        _noise,
        _zeros,
        _again,
        _line_again,
        _line_gone,
        _lines_swapped,
        _word,
        _word,
        _word,
    ),
)


def other_values(rng: np.random.Generator, document: Any, most: int = 2) -> Any:
    """A nested value with one to `most` entries replaced, taken out, added or moved."""
    document = copy.deepcopy(document)
    for _ in range(rng.integers(1, most + 1)):
        places = list(_places(document))
        if not places:
            return document
        holder, key = places[int(rng.integers(len(places)))]
        _change(rng, holder, key)
    return document


def _places(value: Any) -> Any:
    """Every holder with each of its keys."""
    keys = list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        yield value, key
        yield from _places(value[key])


def _change(rng: np.random.Generator, holder: Any, key: Any) -> None:
    how = int(rng.integers(10))
    value = holder[key]
    if how == 0:
        del holder[key]
    elif how == 1 and isinstance(holder, dict):
        holder[["kind", "Ts", "x", "", "version", "theta"][int(rng.integers(6))]] = _value(rng)
    elif how == 2 and isinstance(value, list) and value:
        value.append(copy.deepcopy(value[-1]))
    elif how == 3 and isinstance(value, list) and value:
        value.pop()
    elif how == 4 and isinstance(holder, dict):
        holder[str(key) + "x"] = holder.pop(key)
    elif how <= 6 and isinstance(value, int | float) and not isinstance(value, bool):
        factor = (-1, 0, 10, 1e-3, 1e6, 1e12, 1 + 1e-9)[int(rng.integers(7))]
        holder[key] = type(value)(value * factor) if abs(value) < 1e200 else 0
    else:
        holder[key] = _value(rng)


def _value(rng: np.random.Generator) -> Any:
    return copy.deepcopy(VALUES[int(rng.integers(len(VALUES)))])
