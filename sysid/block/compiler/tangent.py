"""Forward-mode derivatives of a program, source to source, of the branch taken, on two levels.

In a segment (between two loops or within the innermost loop) every value has its derivatives with respect to the
values at the start of the segment: a number for each state, input and parameter on which it depends. At the end of the
segment one pass over the columns of the Jacobian updates the vectors of the live variables with these numbers. A
column then costs one product per dependence, for any length of the segment, and zeros cost nothing.
"""

from sysid.block.compiler.activity import alive, head, now
from sysid.block.compiler.derive import Coefficient, Derivatives, Key, Map, product, row, show, variable
from sysid.block.compiler.ir import Ago, Assign, Body, Break, Expr, For, If, Return, Stmt, Var, ends, loops, statements


class Columns(Derivatives):
    """Lines that convert the derivatives of a segment to vectors, one entry for each column."""

    def _place(self, v: Var) -> str:
        if v == self.output:
            return "J[t, {}]"
        self.vectors.add(f"d{variable(v)}")
        return f"d{variable(v)}[{{}}]"

    def commit(self, env: dict[Var, Map], live: frozenset[Var], y: Map | None = None) -> None:
        """Update the vectors of the live variables."""
        updates: list[tuple[str, Key, Map]] = [
            (self._place(v), ("v", variable(v)), m) for v, m in env.items() if v in live
        ]
        updates += [("J[t, {}]", ("y",), y)] if y is not None else []
        wide = self.narrow or any(k[0] in "xr" for _, _, m in updates for k in m)
        bare: set[str] = set()  # nothing but own columns
        spans = [("q, n", "v")] if self.memoryless else [("q", "vxr"), ("q, n", "v")] if wide else [("n", "v")]
        slopes = self._slopes_of(updates) if self.memoryless else []
        for span, kinds in spans:
            rows = []
            for place, key, m in updates:
                terms = {k: c for k, c in m.items() if k[0] in kinds}
                if not terms and span == "q, n" and self.narrow:
                    bare.add(place)
                elif terms != {key: 1.0}:
                    rows.append((place.format("c"), self._row(terms)))
            if rows:
                self.emit(f"for c in range({span}):")
                self.inside(lambda rows=rows: self._columns(rows))
        self._columns(slopes)
        for place, _, m in updates:
            if place in bare:
                for p in self.program.params:
                    self.emit(f"{place.format(f'c_{p}')} = {m.get(('p', p), 0.0)}")
            else:
                self._own(place, m)

    def _slopes_of(self, moved: list[tuple[str, Key, Map]]) -> list[tuple[str, str]]:
        """d/dx of the live variables (a number without states) from d/dx at the start of the segment."""
        rows = []
        for _, key, m in moved:
            kept = {k: c for k, c in m.items() if k[0] in "vx"}
            if kept != {key: 1.0}:
                terms = [product(c, self._slope(k)) for k, c in kept.items()]
                rows.append((str(self._slope(key)), " + ".join(terms) or "0.0"))
        return rows

    def _slope(self, key: Key) -> Coefficient:
        if key == ("x",):
            return 1.0
        if key == ("y",) or (self.output is not None and key[1] == variable(self.output)):
            return "slope[t]"
        self.numbers.add(f"g{key[1]}")
        return f"g{key[1]}"

    def _columns(self, rows: list[tuple[str, str]]) -> None:
        if len(rows) == 1:
            self.emit(f"{rows[0][0]} = {rows[0][1]}")
            return
        for i, (_, text) in enumerate(rows):
            self.emit(f"n{i} = {text}")
        for i, (place, _) in enumerate(rows):
            self.emit(f"{place} = n{i}")

    def _row(self, m: Map) -> str:
        return " + ".join(product(c, self._entry(k)) for k, c in m.items()) or "0.0"

    def _entry(self, key: Key) -> str:
        """Column c of the tangent for a key."""
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
                # A vector has one more cell, of index -1, for parameters that the block does not have; J has none.
                guard = f"if c_{key[1]} >= 0: " if key[1] in self.optional and place.startswith("J") else ""
                self.emit(f"{guard}{place.format(f'c_{key[1]}')} += {c}")
            elif key[0] == "a":
                self.emit(f"{place.format(f'q + {key[1]}')} += {c}")


_TUPLE = 30  # entries: of more Python makes a list first
_SMALL = 6  # statements behind an if that are written into both of its branches


class Writer(Columns):
    """Lines of the kernel with tangents, and the definitions that they need at its head."""

    def block(self, body: Body, out: frozenset[Var], left: frozenset[Var]) -> None:
        """A body whose vectors are up to date at its start and its end."""
        i = 0
        while i < len(body):
            j = i
            while j < len(body) and not loops(body[j]):
                j += 1
            if j > i:
                self.run(body[i:j], {}, alive(body[j:], out, left, self.states, self.found), left)
            if j < len(body):
                self._nested_loop(body[j], alive(body[j + 1 :], out, left, self.states, self.found), left)
            i = j + 1

    def _nested_loop(self, s: Stmt, out: frozenset[Var], left: frozenset[Var]) -> None:
        if isinstance(s, For):
            self.emit(f"for v_{s.index} in range({show(s.count)}):")
            self.inside(lambda: self.block(s.body, head(s, out, self.states, self.found), out))
        elif isinstance(s, If):
            self.emit(f"if {show(s.test)}:")
            self.inside(lambda: self.block(s.body, out, left))
            if s.orelse:
                self.emit("else:")
                self.inside(lambda: self.block(s.orelse, out, left))

    def run(self, body: Body, env: dict[Var, Map], out: frozenset[Var], left: frozenset[Var], final: bool = True):
        """Statements without a loop; env holds the derivatives of the variables that they set.

        Ends with the vectors of `out` up to date if `final`, else gives env; None where control never gets to the end.
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
                    self.inside(lambda s=s, rest=rest, env=env: self._leaf(s.body, rest, env, out, left))
                    self.emit("else:")
                    self.inside(lambda s=s, rest=rest, env=env: self._leaf(s.orelse, rest, env, out, left))
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
        """Both branches, followed by one common set of derivatives."""
        self.emit(f"if {show(s.test)}:")
        begin = len(self.lines)
        a = self.inside(lambda: self.run(s.body, dict(env), out, left, final=ends(s.body)))
        middle = len(self.lines)
        self.emit("else:")
        b = self.inside(lambda: self.run(s.orelse, dict(env), out, left, final=ends(s.orelse)))
        if a is None or b is None:
            return b if a is None else a  # type: ignore[return-value]
        first, second, names = [], [], []
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
                first.append(str(x))
                second.append(str(y))
                names.append(f"m{self.count}")
                merged[v][key] = names[-1]
        pad = "    " * (self.depth + 1)
        # Tuples, since numba's time grows with the number of variables that two branches set.
        for k in range(0, len(names), _TUPLE):
            part = slice(k, k + _TUPLE)
            self.lines[middle:middle] = [f"{pad}both{k} = ({', '.join(first[part])},)"]
            self.lines.append(f"{pad}both{k} = ({', '.join(second[part])},)")
        for k in range(0, len(names), _TUPLE):
            self.emit(f"{', '.join(names[k : k + _TUPLE])}, = both{k}")
        assert begin <= middle
        return merged

    def assign(self, s: Assign, env: dict[Var, Map]) -> None:
        v, target = s.target, variable(s.target)
        if v in self.found.inputs:
            if isinstance(s.value, Ago) and not now(s.value):
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

    def give(self, e: Expr, env: dict[Var, Map]) -> None:
        """The output of this sample and the states of the next."""
        value, derivative = self.derive(e, env)
        self.emit(f"y[t] = {value}")
        if self.output is not None:
            self.commit(env, self.states | {self.output})
        else:
            self.commit(env, self.states, derivative)
