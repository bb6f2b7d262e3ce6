"""One pass over the columns of the Jacobian that updates the vectors of a segment; see `tangent`."""

from sysid.block.compiler.derive import Coefficient, Derivatives, Key, Map, product
from sysid.block.compiler.ir import Var
from sysid.block.compiler.show import variable


class Columns(Derivatives):
    """Lines that convert the derivatives of a segment to vectors, one entry for each column."""

    def _place(self, v: Var) -> str:
        if v == self.output:
            return "J[t, {}]"
        self.vectors.add(f"d{variable(v)}")
        return f"d{variable(v)}[{{}}]"

    def commit(self, env: dict[Var, Map], live: frozenset[Var], y: Map | None = None) -> None:
        """Update the vectors of the live variables."""
        moved: list[tuple[str, Key, Map]] = [
            (self._place(v), ("v", variable(v)), m) for v, m in env.items() if v in live
        ]
        moved += [("J[t, {}]", ("y",), y)] if y is not None else []
        wide = self.narrow or any(k[0] in "xr" for _, _, m in moved for k in m)
        bare: set[str] = set()  # nothing but own columns
        spans = [("q, n", "v")] if self.memoryless else [("q", "vxr"), ("q, n", "v")] if wide else [("n", "v")]
        slopes = self._slopes_of(moved) if self.memoryless else []
        for span, kinds in spans:
            rows = []
            for place, own, m in moved:
                kept = {k: c for k, c in m.items() if k[0] in kinds}
                if not kept and span == "q, n" and self.narrow:
                    bare.add(place)
                elif kept != {own: 1.0}:
                    rows.append((place.format("c"), self._row(kept)))
            if rows:
                self.emit(f"for c in range({span}):")
                self.inside(lambda rows=rows: self._columns(rows))
        self._columns(slopes)
        for place, _, m in moved:
            if place in bare:
                for p in self.program.params:
                    self.emit(f"{place.format(f'c_{p}')} = {m.get(('p', p), 0.0)}")
            else:
                self._own(place, m)

    def _slopes_of(self, moved: list[tuple[str, Key, Map]]) -> list[tuple[str, str]]:
        """d/dx of the live variables (a number without states) from d/dx at the start of the segment."""
        rows = []
        for _, own, m in moved:
            kept = {k: c for k, c in m.items() if k[0] in "vx"}
            if kept != {own: 1.0}:
                terms = [product(c, self._slope(k)) for k, c in kept.items()]
                rows.append((str(self._slope(own)), " + ".join(terms) or "0.0"))
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
                guard = f"if c_{key[1]} >= 0: " if key[1] in self.optional else ""
                self.emit(f"{guard}{place.format(f'c_{key[1]}')} += {c}")
            elif key[0] == "a":
                self.emit(f"{place.format(f'q + {key[1]}')} += {c}")
