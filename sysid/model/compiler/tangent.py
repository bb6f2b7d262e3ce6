"""Forward-mode derivatives of a program, source to source: the branch taken, two levels.

Between two loops, and within the innermost one, every value carries its derivatives with respect to what this stretch
began with: a number for each state, input and parameter that it depends on. At the end of the stretch one pass over
the columns of the Jacobian takes these numbers to the vectors of what lives on. So a column costs a product for each
dependence, however long the stretch is, and what is known to be zero costs nothing.
"""

from dataclasses import dataclass, field

from sysid.model.compiler.activity import Activity, activity, alive, head, looks_back, lowered, names, now
from sysid.model.compiler.ir import (
    Ago,
    Assign,
    Body,
    Break,
    Expr,
    For,
    If,
    Num,
    Op,
    Param,
    Program,
    Return,
    Stmt,
    Var,
    ends,
    loops,
    statements,
)
from sysid.model.compiler.show import row, show, variable

Key = tuple[str, ...]
Coefficient = str | float
Map = dict[Key, Coefficient]
_FEW = 6  # parameters whose columns are set one by one where no vector stands behind them
_SMALL = 6  # statements behind an if that are written into both of its branches


@dataclass
class Writer:
    """Lines of the kernel with tangents, and what they ask for at its head."""

    program: Program
    optional: frozenset[str]
    lines: list[str] = field(default_factory=list)
    vectors: set[str] = field(default_factory=set)
    places: list[str] = field(default_factory=list)  # whole numbers that a branch not taken leaves unset
    depth: int = 0

    def __post_init__(self) -> None:
        self.found: Activity = activity(self.program)
        taken = names(self.program)
        self.begin = lowered(self.program.begin, self.found, taken)
        self.step = lowered(self.program.step, self.found, taken)
        lower = Program(*(getattr(self.program, k) for k in ("states", "params", "rows", "consts")), self.begin, self.step)
        self.found = activity(lower)
        self.states = frozenset(v for v in self.found.active if v.state)
        self.back = looks_back(self.program)
        self.known: dict[Var, Map] = {}  # derivatives of light variables that are the same numbers everywhere
        self.count = 0
        self.output = self._output()
        self.narrow = not self.program.rows and not self.optional and len(self.program.params) <= _FEW
        self.buffered = self.output is not None and not self.back
        self.assigned = [s.target for b in (self.begin, self.step) for s in statements(b) if isinstance(s, Assign)]

    def _output(self) -> Var | None:
        """The variable that is the output and lives through loops: its vector is the row of the Jacobian itself."""
        given = {s.value for s in statements(self.step) if isinstance(s, Return)}
        if len(given) != 1 or not any(loops(s) for s in self.step):
            return None
        (value,) = given
        vector = isinstance(value, Var) and value in self.found.vectors(value) and not value.state
        return value if vector and isinstance(value, Var) else None

    # Lines

    def emit(self, line: str) -> None:
        self.lines.append("    " * self.depth + line)

    def temporary(self, text: str) -> str:
        self.count += 1
        self.emit(f"t{self.count} = {text}")
        return f"t{self.count}"

    # Statements

    def block(self, body: Body, out: frozenset[Var], left: frozenset[Var]) -> None:
        """A body whose vectors are up to date where it begins, and where it ends."""
        i = 0
        while i < len(body):
            j = i
            while j < len(body) and not loops(body[j]):
                j += 1
            if j > i:
                self.run(body[i:j], {}, alive(body[j:], out, left, self.states, self.found), left)
            if j < len(body):
                self._nested(body[j], alive(body[j + 1 :], out, left, self.states, self.found), left)
            i = j + 1

    def _nested(self, s: Stmt, out: frozenset[Var], left: frozenset[Var]) -> None:
        if isinstance(s, For):
            self.emit(f"for v_{s.index} in range({show(s.count)}):")
            self.inside(lambda: self.block(s.body, head(s, out, self.states, self.found), out))
        elif isinstance(s, If):
            self.emit(f"if {show(s.test)}:")
            self.inside(lambda: self.block(s.body, out, left))
            if s.orelse:
                self.emit("else:")
                self.inside(lambda: self.block(s.orelse, out, left))

    def inside(self, write) -> object:  # type: ignore[no-untyped-def]
        """What `write` writes, one level in."""
        self.depth += 1
        before = len(self.lines)
        result = write()
        if len(self.lines) == before:
            self.emit("pass")
        self.depth -= 1
        return result

    def run(self, body: Body, env: dict[Var, Map], out: frozenset[Var], left: frozenset[Var], final: bool = True):  # type: ignore[no-untyped-def]
        """Statements without a loop; env holds the derivatives of what they have set. Ends with the vectors of `out`
        up to date if `final`, else gives env; None where control never gets to the end.
        """
        for i, s in enumerate(body):
            rest = body[i + 1 :]
            if isinstance(s, Assign):
                self.assign(s, env)
            elif isinstance(s, Break):
                self.commit(env, left)
                self.emit("break")
                return None
            elif isinstance(s, Return):
                self.give(s.value, env)
                return None
            elif isinstance(s, If):
                if final and (ends(s.body) or ends(s.orelse) or sum(1 for _ in statements(rest)) <= _SMALL):
                    self.emit(f"if {show(s.test)}:")
                    self.inside(lambda s=s, rest=rest: self._leaf(s.body, rest, env, out, left))  # type: ignore[misc]
                    self.emit("else:")
                    self.inside(lambda s=s, rest=rest: self._leaf(s.orelse, rest, env, out, left))  # type: ignore[misc]
                    return None
                merged = self.merge(s, env, alive(rest, out, left, self.states, self.found), left)
                if merged is None:
                    return None
                env = merged
        if final:
            self.commit(env, out)
        return env

    def _leaf(self, body: Body, rest: Body, env: dict[Var, Map], out: frozenset[Var], left: frozenset[Var]) -> None:
        self.run(body if ends(body) else body + rest, dict(env), out, left)

    def merge(self, s: If, env: dict[Var, Map], out: frozenset[Var], left: frozenset[Var]) -> dict[Var, Map] | None:
        """Both branches, and behind them one set of derivatives whichever was taken."""
        self.emit(f"if {show(s.test)}:")
        begin = len(self.lines)
        a = self.inside(lambda: self.run(s.body, dict(env), out, left, final=ends(s.body)))
        middle = len(self.lines)
        self.emit("else:")
        b = self.inside(lambda: self.run(s.orelse, dict(env), out, left, final=ends(s.orelse)))
        if a is None or b is None:
            return b if a is None else a  # type: ignore[return-value]
        first, second = [], []
        merged: dict[Var, Map] = {}
        for v in sorted({*a, *b}, key=variable):  # type: ignore[misc]
            if v not in out and v not in self.found.light:
                continue
            one, other = a.get(v, {("v", variable(v)): 1.0}), b.get(v, {("v", variable(v)): 1.0})  # type: ignore[attr-defined]
            merged[v] = {}
            for key in sorted({*one, *other}):
                x, y = one.get(key, 0.0), other.get(key, 0.0)
                if x == y:
                    merged[v][key] = x
                    continue
                self.count += 1
                first.append(f"m{self.count} = {x}")
                second.append(f"m{self.count} = {y}")
                merged[v][key] = f"m{self.count}"
        pad = "    " * (self.depth + 1)
        self.lines[middle:middle] = [pad + line for line in first]
        self.lines += [pad + line for line in second]
        assert begin <= middle
        return merged

    # Derivatives

    def assign(self, s: Assign, env: dict[Var, Map]) -> None:
        v, target = s.target, variable(s.target)
        if v in self.found.inputs:
            if not now(s.value):
                self.places.append(f"row_{v.name}")
                self.emit(f"row_{v.name} = {row(s.value)}")
            self.emit(f"{target} = {show(s.value)}")
            return
        if v not in self.found.active:
            self.emit(f"{target} = {show(s.value)}")
            return
        value, derivative = self.derive(s.value, env)
        if v in self.found.light:
            self._light(v, derivative)
        else:
            env[v] = derivative
        self.emit(f"{target} = {value}")

    def _light(self, v: Var, derivative: Map) -> None:
        if self.assigned.count(v) == 1 and all(isinstance(c, float) or c.startswith("p_") for c in derivative.values()):
            self.known[v] = derivative
            return
        for key in self._parameters(v):
            self.emit(f"l_{v.name}_{key} = {derivative.get(('p', key), 0.0)}")

    def _parameters(self, v: Var, seen: frozenset[Var] = frozenset()) -> list[str]:
        """The parameters that a light variable depends on."""
        found: set[str] = set()
        for s in (s for b in (self.begin, self.step) for s in statements(b) if isinstance(s, Assign) and s.target == v):
            for leaf in self.found.leaves(s.value):
                if isinstance(leaf, Param):
                    found.add(leaf.name)
                elif isinstance(leaf, Var) and leaf not in seen and leaf != v:
                    found |= set(self._parameters(leaf, seen | {v}))
        return sorted(found)

    def derive(self, e: Expr, env: dict[Var, Map]) -> tuple[str, Map]:
        """Name of the value of an expression, and its derivatives."""
        values: dict[int, str] = {}
        terms: dict[Key, list[tuple[Coefficient, Coefficient]]] = {}
        value = self._value(e, values)
        self._pull(e, 1.0, values, env, terms)
        found: Map = {}
        for key, pairs in terms.items():
            c = self._sum(pairs)
            if c != 0.0:
                found[key] = c
        return value, found

    def _value(self, e: Expr, values: dict[int, str]) -> str:
        """A name or number for the value of an expression, set down where it is none yet."""
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

    def _pull(self, e, factor, values, env, terms) -> None:  # type: ignore[no-untyped-def]
        """Spread d value / d e, which is `factor`, over what e depends on (reverse mode within one expression)."""
        if not self.found.of(e):
            return
        if not isinstance(e, Op):
            for key, c in self._leaf_map(e, values, env).items():
                terms.setdefault(key, []).append((factor, c))
            return
        args = [self._value(a, values) for a in e.args]
        own = self._value(e, values)
        for arg, slope in zip(e.args, self._slopes(e, args, own), strict=True):
            if self.found.of(arg):
                self._pull(arg, self._times(factor, slope()), values, env, terms)

    def _slopes(self, e: Op, a: list[str], own: str):  # type: ignore[no-untyped-def]
        """How the value changes with each argument, written down only where it is asked for."""
        t = self.temporary
        table = {
            "+": (lambda: 1.0, lambda: 1.0),
            "-": (lambda: 1.0, lambda: -1.0),
            "neg": (lambda: -1.0,),
            "*": (lambda: _float(a[1]), lambda: _float(a[0])),
            "/": (lambda: t(f"1.0 / {a[1]}"), lambda: t(f"-({own} / {a[1]})")),
            "**": (lambda: t(f"{a[1]} * {a[0]} ** ({a[1]} - 1.0)"), lambda: t(f"{own} * log({a[0]})")),
            "exp": (lambda: own,),
            "log": (lambda: t(f"1.0 / {a[0]}"),),
            "sqrt": (lambda: t(f"0.5 / {own}"),),
            "tanh": (lambda: t(f"1.0 - {own} * {own}"),),
            "sin": (lambda: t(f"cos({a[0]})"),),
            "cos": (lambda: t(f"-sin({a[0]})"),),
            "abs": (lambda: t(f"1.0 if {a[0]} > 0.0 else (-1.0 if {a[0]} < 0.0 else 0.0)"),),
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
            source = next(s.value for b in (self.begin, self.step) for s in statements(b) if _sets(s, e))
            return {("x",): 1.0} if now(source) else {("r", f"row_{e.name}"): 1.0}
        return {("v", variable(e)): 1.0}

    def _times(self, a: Coefficient, b: Coefficient) -> Coefficient:
        if isinstance(a, float) and isinstance(b, float):
            return a * b
        if a == 1.0 or b == 1.0:
            return b if a == 1.0 else a
        if a == 0.0 or b == 0.0:
            return 0.0
        return self.temporary(_product(a, b))

    def _sum(self, pairs: list[tuple[Coefficient, Coefficient]]) -> Coefficient:
        numbers = [a * b for a, b in pairs if isinstance(a, float) and isinstance(b, float)]
        texts = [_product(a, b) for a, b in pairs if not (isinstance(a, float) and isinstance(b, float))]
        number = sum(numbers)
        if not texts:
            return float(number)
        if len(texts) == 1 and not number and texts[0].isidentifier() and texts[0][0] in "tmp":
            return texts[0]
        return self.temporary(" + ".join([*texts, *([repr(number)] if number else [])]))

    # Vectors

    def give(self, e: Expr, env: dict[Var, Map]) -> None:
        """The output of this sample, and with it the states of the next."""
        value, derivative = self.derive(e, env)
        self.emit(f"y[t] = {value}")
        if self.output is not None:
            self.commit(env, self.states | {self.output})
        else:
            self.commit(env, self.states, derivative)

    def _place(self, v: Var) -> str:
        if v == self.output:
            return "J[t, {}]"
        self.vectors.add(f"d{variable(v)}")
        return f"d{variable(v)}[{{}}]"

    def commit(self, env: dict[Var, Map], live: frozenset[Var], y: Map | None = None) -> None:
        """Bring the vectors of what lives on up to date."""
        moved = [(self._place(v), ("v", variable(v)), m) for v, m in env.items() if v in live]
        moved += [("J[t, {}]", ("y",), y)] if y is not None else []
        wide = self.narrow or any(k[0] in "xr" for _, _, m in moved for k in m)
        bare: set[str] = set()  # nothing but own columns
        for span, kinds in ((("q", "vxr"), ("q, n", "v")) if wide else (("n", "v"),)):
            rows = []
            for place, own, m in moved:
                kept = {k: c for k, c in m.items() if k[0] in kinds}
                if not kept and span == "q, n" and self.narrow:
                    bare.add(place)
                elif kept != {own: 1.0}:
                    rows.append((place.format("c"), self._row(kept)))
            if rows:
                self.emit(f"for c in range({span}):")
                self.inside(lambda rows=rows: self._columns(rows))  # type: ignore[misc]
        for place, _, m in moved:
            if place in bare:
                for p in self.program.params:
                    self.emit(f"{place.format(f'c_{p}')} = {m.get(('p', p), 0.0)}")
            else:
                self._own(place, m)

    def _columns(self, rows: list[tuple[str, str]]) -> None:
        if len(rows) == 1:
            self.emit(f"{rows[0][0]} = {rows[0][1]}")
            return
        for i, (_, text) in enumerate(rows):
            self.emit(f"n{i} = {text}")
        for i, (place, _) in enumerate(rows):
            self.emit(f"{place} = n{i}")

    def _row(self, m: Map) -> str:
        return " + ".join(_product(c, self._entry(k)) for k, c in m.items()) or "0.0"

    def _entry(self, key: Key) -> str:
        """Column c of the tangent that a key stands for."""
        if key[0] == "v":
            if self.output is not None and key[1] == variable(self.output):
                return "J[t, c]"
            self.vectors.add(f"d{key[1]}")
            return f"d{key[1]}[c]"
        if key[0] == "r":
            return f"W[{key[1]}, c]"
        return "W[t, c]" if self.back else "dx[c]" if self.buffered else "J[t, c]"

    def _own(self, place: str, m: Map) -> None:
        for key, c in m.items():
            if key[0] == "p":
                guard = f"if c_{key[1]} >= 0: " if key[1] in self.optional else ""
                self.emit(f"{guard}{place.format(f'c_{key[1]}')} += {c}")
            elif key[0] == "a":
                self.emit(f"{place.format(f'q + {key[1]}')} += {c}")


def _sets(s: Stmt, v: Var) -> bool:
    return isinstance(s, Assign) and s.target == v


def _float(text: str) -> Coefficient:
    """A coefficient as a number where the text is one."""
    try:
        return float(text)
    except ValueError:
        return text


def _product(a: Coefficient, b: Coefficient) -> str:
    if a == 1.0 or b == 1.0:
        return str(b if a == 1.0 else a)
    if a == -1.0 or b == -1.0:
        return f"-{b if a == -1.0 else a}"
    return f"{a} * {b}"
