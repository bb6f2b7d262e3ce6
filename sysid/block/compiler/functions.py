"""The functions that a step may call, one line each: their value, derivative, and what every language calls them."""

import math
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass

from sysid.block.compiler.ir import COMPARISONS, Expr, Num, Op
from sysid.block.step import floor, logistic, sign


@dataclass(frozen=True)
class Function:
    """One function: `value` of numbers, and texts of what is derived from a step.

    `slope` is its derivative, from its argument {a} and its own value {own}; min and max, which the compiler makes into
    branches, have none. `kernel` are the lines that a kernel needs to call it by its name. `python` and `c` are calls
    with {} for the arguments, `matlab` a name; a function that they lack is put in as an expression, `spelt`.
    """

    value: Callable[..., float]
    slope: str = ""
    kernel: str = ""
    python: str = ""
    c: str = ""
    matlab: str = ""
    spelt: Callable[[Expr], Op] | None = None


def _math(name: str, slope: str, python: str = "") -> Function:
    """A function that Python's math, C and MATLAB have under one name."""
    call = f"{name}({{}})"
    return Function(getattr(math, name), slope, f"from math import {name}", python or f"math.{call}", call, name)


def _spelt_logistic(a: Expr) -> Op:
    return Op("/", (Num(1.0), Op("+", (Num(1.0), Op("exp", (Op("neg", (a,)),))))))


def _spelt_sign(a: Expr) -> Op:
    below = Op("if", (Op("<", (a, Num(0.0))), Op("neg", (Num(1.0),)), Num(0.0)))
    return Op("if", (Op(">", (a, Num(0.0))), Num(1.0), below))


_NONE = "0.0"
_LOGISTIC = """
@njit(inline="always")
def logistic(x):
    return 1.0 / (1.0 + exp(-x))
"""
FUNCTIONS = {
    # 1 / (1 + exp(z)) has the slope 0 where exp is infinite. Python's exp raises beyond 709.
    "exp": _math("exp", f"min({{own}}, {sys.float_info.max!r})", "math.exp(min({}, 700.0))"),
    "log": _math("log", "1.0 / {a}"),
    "sqrt": _math("sqrt", "0.5 / {own}"),
    "tanh": _math("tanh", "1.0 - {own} * {own}"),
    "logistic": Function(logistic, "{own} * (1.0 - {own})", _LOGISTIC, spelt=_spelt_logistic),
    "sin": _math("sin", "cos({a})"),
    "cos": _math("cos", "-sin({a})"),
    "acos": _math("acos", "-1.0 / sqrt(1.0 - {a} * {a})"),
    "floor": Function(floor, _NONE, "from numpy import floor", "math.floor({})", "floor({})", "floor"),
    "sign": Function(sign, _NONE, "from numpy import sign", spelt=_spelt_sign),
    "abs": Function(
        abs, "1.0 if {a} > 0.0 else (-1.0 if {a} < 0.0 else 0.0)", python="abs({})", c="fabs({})", matlab="abs"
    ),
    "int": Function(int, _NONE, python="int({})", c="(long)({})", matlab="fix"),
    "min": Function(min, python="min({})", c="min_of({})", matlab="min"),
    "max": Function(max, python="max({})", c="max_of({})", matlab="max"),
}
FLAT = {name for name, f in FUNCTIONS.items() if f.slope == _NONE} | {"and", "or", "not", *COMPARISONS}
KERNEL = "\n".join(f.kernel for f in FUNCTIONS.values() if f.kernel)  # the head of every kernel
EXPORTED = set(re.findall(r"[a-z_]+", " ".join(f.python + f.c for f in FUNCTIONS.values())))  # names for no variable
MATLAB = {f.python.partition("(")[0]: f.matlab for f in FUNCTIONS.values() if f.matlab}  # by the call in Python
