"""Expressions as text of the kernels, and their derivatives in the values at the start of a segment; see `tangent`."""

from dataclasses import dataclass, field, replace

from sysid.block.compiler.activity import Activity, activity, looks_back, lower_branches, memoryless, names, now
from sysid.block.compiler.functions import FUNCTIONS
from sysid.block.compiler.ir import (
    COMPARISONS,
    Ago,
    Assign,
    Const,
    Expr,
    Num,
    Op,
    Param,
    Program,
    Return,
    Var,
    loops,
    statements,
)


def variable(v: Var) -> str:
    """The name of a variable or a state in a kernel."""
    return f"s_{v.name}" if v.state else f"v_{v.name}"


def show(e: Expr, args: list[str] | None = None, place: bool = False) -> str:
    """An expression; `args` are texts of its arguments; `place` gives the position of a row's parameter in theta."""
    if isinstance(e, Num):
        return repr(e.value) if e.value >= 0 else f"({e.value!r})"
    if isinstance(e, Var):
        return variable(e)
    if isinstance(e, Const):
        return f"k_{e.name}"
    if isinstance(e, Param):
        if e.index is None:
            return f"p_{e.name}"
        # Whatever a state has become, memory beside the row is not touched.
        where = f"a_{e.name} + min(max({show(e.index)}, 0), n_{e.name} - 1)"
        return where if place else f"theta[{where}]"
    if isinstance(e, Ago):
        return "u" if e.n == Num(0) else f"x[{row(e)}]"
    a = [show(each) for each in e.args] if args is None else list(args)
    if e.op == "**" and not isinstance(e.args[0], (Param, Ago)):  # whole numbers to a negative power, or beyond 2**63
        base = e.args[0]
        a[0] = f"{float(base.value)!r}" if isinstance(base, Num) and base.value >= 0 else f"float({a[0]})"
    return operation(e, a)


def row(e: Ago) -> str:
    """Sample number of an earlier input."""
    return f"max(t - {show(e.n) if e.checked else f'max({show(e.n)}, 0)'}, 0)"


def operation(e: Op, a: list[str]) -> str:
    """An operation on written arguments, in brackets if needed."""
    if e.op in ("+", "-", "*", "/", "**", "and", "or", *COMPARISONS):
        return f"({a[0]} {e.op} {a[1]})"
    if e.op == "neg":
        return f"(-{a[0]})"
    if e.op == "not":
        return f"(not {a[0]})"
    if e.op == "if":
        return f"({a[1]} if {a[0]} else {a[2]})"
    return f"{e.op}({', '.join(a)})"


Key = tuple[
    str, ...
]  # v: a vector by name, p: a parameter, a: one of a row, x: the input, r: an earlier one, y: output
Coefficient = str | float
Map = dict[Key, Coefficient]
_FEW = 6  # parameters whose columns are set one by one where no vector stands behind them


@dataclass
class Derivatives:
    """Lines of the kernel with tangents, and the definitions that they need at its head."""

    program: Program
    optional: frozenset[str]
    lines: list[str] = field(default_factory=list)
    vectors: set[str] = field(default_factory=set)
    numbers: set[str] = field(default_factory=set)  # d/dx of local variables, without states
    places: list[str] = field(default_factory=list)  # whole numbers that a branch not taken leaves unset
    depth: int = 0

    def __post_init__(self) -> None:
        self.found: Activity = activity(self.program)
        reserved = names(self.program)
        self.begin = lower_branches(self.program.begin, self.found, reserved)
        self.step = lower_branches(self.program.step, self.found, reserved)
        self.found = activity(replace(self.program, begin=self.begin, step=self.step))
        self.states = frozenset(v for v in self.found.active if v.state)
        self.back = looks_back(self.program)
        self.memoryless = memoryless(self.program)  # d/dx is a number then, `slope`
        self.known: dict[Var, Map] = {}  # derivatives of light variables that are the same numbers everywhere
        self.count = 0
        self.output = self._output()
        self.narrow = not self.program.rows and not self.optional and len(self.program.params) <= _FEW
        self.buffered = self.output is not None and not self.back and not self.memoryless
        self.assigned = [s.target for b in (self.begin, self.step) for s in statements(b) if isinstance(s, Assign)]

    def _output(self) -> Var | None:
        """The output variable if it is live through loops: its vector is the row of the Jacobian itself."""
        outputs = {s.value for s in statements(self.step) if isinstance(s, Return)}
        if len(outputs) != 1 or not any(loops(s) for s in self.step):
            return None
        (value,) = outputs
        vector = isinstance(value, Var) and value in self.found.vectors(value) and not value.state
        return value if vector and isinstance(value, Var) else None

    def emit(self, line: str) -> None:
        self.lines.append("    " * self.depth + line)

    def temporary(self, text: str) -> str:
        self.count += 1
        self.emit(f"t{self.count} = {text}")
        return f"t{self.count}"

    def inside(self, write) -> object:
        """The lines written by `write`, indented by one level."""
        self.depth += 1
        before = len(self.lines)
        result = write()
        if len(self.lines) == before:
            self.emit("pass")
        self.depth -= 1
        return result

    def derive(self, e: Expr, env: dict[Var, Map]) -> tuple[str, Map]:
        """Name of an expression's value, and its derivatives."""
        values: dict[int, str] = {}
        terms: dict[Key, list[tuple[Coefficient, Coefficient]]] = {}
        value = self._value(e, values)
        self._pull(e, 1.0, values, env, terms)
        derivative: Map = {}
        for key, pairs in terms.items():
            c = self._sum(pairs)
            if c != 0.0:
                derivative[key] = c
        return value, derivative

    def _value(self, e: Expr, values: dict[int, str]) -> str:
        """A name or number for the value of an expression; assigned to a new name if necessary."""
        if id(e) not in values:
            if not self.found.of(e):
                text = show(e)
                values[id(e)] = self.temporary(text) if isinstance(e, Op) else text
            elif isinstance(e, Op):
                values[id(e)] = self.temporary(show(e, [self._value(a, values) for a in e.args]))
            elif isinstance(e, Param) and e.index is not None:
                self.count += 1
                self.places.append(f"i{self.count}")
                self.emit(f"i{self.count} = {show(e, place=True)}")
                self.emit(f"t{self.count} = theta[i{self.count}]")
                values[id(e)] = f"t{self.count}"
            elif isinstance(e, Ago) and not now(e):
                self.count += 1
                self.places.append(f"row_{self.count}")
                self.emit(f"row_{self.count} = {row(e)}")
                self.emit(f"t{self.count} = x[row_{self.count}]")
                values[id(e)] = f"t{self.count}"
            else:
                values[id(e)] = show(e)
        return values[id(e)]

    def _pull(self, e, factor, values, env, terms) -> None:
        """Distribute `factor` = d value / d e to the dependences of e (reverse mode within one expression)."""
        if not self.found.of(e):
            return
        if not isinstance(e, Op):
            for key, c in self._leaf_map(e, values, env).items():
                terms.setdefault(key, []).append((factor, c))
            return
        args = [self._value(a, values) for a in e.args]
        value = self._value(e, values)
        for arg, slope in zip(e.args, self._slopes(e, args, value), strict=True):
            if self.found.of(arg):
                self._pull(arg, self._times(factor, slope()), values, env, terms)

    def _slopes(self, e: Op, a: list[str], own: str):
        """Derivative of the value with respect to each argument, written only if needed."""
        t = self.temporary
        if e.op in FUNCTIONS:
            return (lambda: t(FUNCTIONS[e.op].slope.format(a=a[0], own=own)),)
        table = {
            "+": (lambda: 1.0, lambda: 1.0),
            "-": (lambda: 1.0, lambda: -1.0),
            "neg": (lambda: -1.0,),
            "*": (lambda: _float(a[1]), lambda: _float(a[0])),
            "/": (lambda: t(f"1.0 / {a[1]}"), lambda: t(f"-({own} / {a[1]})")),
            "**": (lambda: t(f"{a[1]} * {a[0]} ** ({a[1]} - 1.0)"), lambda: t(f"{own} * log({a[0]})")),
        }
        return table[e.op]

    def _leaf_map(self, e: Expr, values: dict[int, str], env: dict[Var, Map]) -> Map:
        if isinstance(e, Param):
            return {("p", e.name): 1.0} if e.index is None else {("a", values[id(e)].replace("t", "i")): 1.0}
        if isinstance(e, Ago):
            return {("x",): 1.0} if now(e) else {("r", values[id(e)].replace("t", "row_")): 1.0}
        assert isinstance(e, Var)
        if e in env:
            return env[e]
        if e in self.known:
            return self.known[e]
        if e in self.found.light:
            return {("p", k): self.temporary(f"l_{e.name}_{k}") for k in self._parameters(e)}
        if e in self.found.inputs:
            lines = (s for b in (self.begin, self.step) for s in statements(b))
            source = next(s.value for s in lines if isinstance(s, Assign) and s.target == e)
            return {("x",): 1.0} if now(source) else {("r", f"row_{e.name}"): 1.0}
        return {("v", variable(e)): 1.0}

    def _times(self, a: Coefficient, b: Coefficient) -> Coefficient:
        if isinstance(a, float) and isinstance(b, float):
            return a * b
        if a == 1.0 or b == 1.0:
            return b if a == 1.0 else a
        if a == 0.0 or b == 0.0:
            return 0.0
        return self.temporary(product(a, b))

    def _sum(self, pairs: list[tuple[Coefficient, Coefficient]]) -> Coefficient:
        numbers = [a * b for a, b in pairs if isinstance(a, float) and isinstance(b, float)]
        texts = [product(a, b) for a, b in pairs if not (isinstance(a, float) and isinstance(b, float))]
        number = sum(numbers)
        if not texts:
            return float(number)
        if len(texts) == 1 and not number and texts[0].isidentifier() and texts[0][0] in "tmp":
            return texts[0]
        return self.temporary(" + ".join([*texts, *([repr(number)] if number else [])]))

    def _light(self, v: Var, derivative: Map) -> None:
        if self.assigned.count(v) == 1 and all(isinstance(c, float) or c.startswith("p_") for c in derivative.values()):
            self.known[v] = derivative
            return
        for key in self._parameters(v):
            self.emit(f"l_{v.name}_{key} = {derivative.get(('p', key), 0.0)}")

    def _parameters(self, v: Var, seen: frozenset[Var] = frozenset()) -> list[str]:
        """The parameters on which a light variable depends."""
        parameters: set[str] = set()
        for s in (s for b in (self.begin, self.step) for s in statements(b) if isinstance(s, Assign) and s.target == v):
            for leaf in self.found.leaves(s.value):
                if isinstance(leaf, Param):
                    parameters.add(leaf.name)
                elif isinstance(leaf, Var) and leaf not in seen and leaf != v:
                    parameters |= set(self._parameters(leaf, seen | {v}))
        return sorted(parameters)


def _float(text: str) -> Coefficient:
    """A coefficient as a number if the text is a number."""
    try:
        return float(text)
    except ValueError:
        return text


def product(a: Coefficient, b: Coefficient) -> str:
    if a == 1.0 or b == 1.0:
        return str(b if a == 1.0 else a)
    if a == -1.0 or b == -1.0:
        return f"-{b if a == -1.0 else a}"
    return f"{a} * {b}"
