"""A reader of the Modelica that exports are written in: it knows the language from its specification (3.6), no more.

It turns a model into Python line by line and checks what a compiler would: types of assignments, truth of conditions,
places within their arrays, names that exist and are no words of the language, and values before they are read.
"""

import math
import re

import numpy as np

TOKEN = re.compile(r'\s*("[^"]*"|\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|[A-Za-z_]\w*|<=|>=|==|<>|\S)')
RELATIONS = {"<": "<", "<=": "<=", ">": ">", ">=": ">=", "==": "==", "<>": "!="}
TYPES = {"Real": (float, int), "Integer": (int,), "Boolean": (bool,)}


def _fits(kind, value):
    """The value, which a variable of this type may hold."""
    for each in value if isinstance(value, list) else [value]:
        assert isinstance(each, bool) == (kind == "Boolean"), (kind, each)
        assert isinstance(each, TYPES[kind]), (kind, each)
    return [float(v) for v in value] if isinstance(value, list) and kind == "Real" else value


def _truth(value):
    assert isinstance(value, bool), value
    return value


def _number(value):
    assert not isinstance(value, bool), value
    return value


def _place(row, k):
    assert isinstance(k, int), k
    assert not isinstance(k, bool)
    assert 1 <= k <= len(row), (k, len(row))
    assert row[k - 1] is not None
    return k - 1


def _span(first, *rest):
    step, last = (1, *rest) if len(rest) == 1 else rest
    return range(first, last + (1 if step > 0 else -1), step)


def exp(x):
    return math.exp(x) if x < 709.7 else math.inf


def log(x):
    return math.log(x) if x > 0.0 else -math.inf if x == 0.0 else math.nan


def _divided(a, b):
    with np.errstate(all="ignore"):
        return float(np.float64(a) / np.float64(b))


BUILT_IN = {
    **{
        "abs": abs,
        "min": min,
        "max": max,
        "sqrt": math.sqrt,
        "sin": math.sin,
        "cos": math.cos,
        "acos": math.acos,
        "tanh": math.tanh,
    },
    **{"exp": exp, "log": log, "floor": lambda x: float(math.floor(x)), "integer": math.floor},
    "size": lambda row, k: len(row),
}


class Expression:
    """One expression as Python."""

    def __init__(self, text):
        self.tokens, self.at = TOKEN.findall(text), 0

    def python(self):
        found = self.any()
        assert self.at == len(self.tokens), self.tokens[self.at :]
        return found

    def peek(self):
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def take(self, wanted=None):
        token = self.peek()
        assert token
        assert wanted in (None, token), (wanted, token)
        self.at += 1
        return token

    def taken(self, word):
        found = self.peek() == word
        self.at += found
        return found

    def any(self):
        if not self.taken("if"):
            return self.either()
        test = self.any()
        self.take("then")
        first = self.any()
        self.take("else")
        return f"({first} if _truth({test}) else {self.any()})"

    def either(self):
        left = self.both()
        while self.taken("or"):
            left = f"(_truth({left}) or _truth({self.both()}))"
        return left

    def both(self):
        left = self.negation()
        while self.taken("and"):
            left = f"(_truth({left}) and _truth({self.negation()}))"
        return left

    def negation(self):
        return f"(not _truth({self.relation()}))" if self.taken("not") else self.relation()

    def relation(self):
        left = self.sum()
        if self.peek() not in RELATIONS:
            return left
        sign = RELATIONS[self.take()]
        return f"(_number({left}) {sign} _number({self.sum()}))"

    def sum(self):
        left = f"(-_number({self.product()}))" if self.taken("-") else self.product()
        while self.peek() in ("+", "-"):
            sign = self.take()
            left = f"(_number({left}) {sign} _number({self.product()}))"
        return left

    def product(self):
        left = self.power()
        while self.peek() in ("*", "/"):
            right = ("_divided({}, {})" if self.take() == "/" else "(_number({}) * _number({}))", self.power())
            left = right[0].format(left, right[1])
        return left

    def power(self):
        left = self.primary()
        return f"({left} ** {self.primary()})" if self.taken("^") else left

    def primary(self):
        token = self.take()
        if token in ("true", "false"):
            return token.capitalize()
        if token[0].isdigit():
            return token
        if token == "(":
            inner = self.any()
            self.take(")")
            return inner
        if token == "{":
            return f"[{self.several('}')}]"
        name = token
        while self.taken("."):
            name += f".{self.take()}"
        if self.taken("("):
            if name == "pre":
                name = f"_old['{self.take()}']"
                self.take(")")
                return name
            return f"{name}({self.several(')')})"
        if not self.taken("["):
            return name
        at = self.any()
        self.take("]")
        return f"{name}[_place({name}, {at})]"

    def several(self, end):
        found = []
        while not self.taken(end):
            found.append(self.any())
            self.taken(",")
        return ", ".join(found)


def expression(text):
    return Expression(text).python()


DECLARED = re.compile(
    r"(?:(input|output|parameter|constant|discrete) )?(Real|Integer|Boolean|RealInput|RealOutput|Values_\w+) (\w+)"
    r"(?:\[([^]]*)\])?(\(.*?\))?(?: = ([^\"]*?))?(?: \"[^\"]*\")?;"
)


def statements(lines, kinds):
    """Python of the statements of an algorithm, each name with its type."""
    found, depth = [], 1
    for line in lines:
        if line in ("end if;", "end for;"):
            depth -= 1
            continue
        if line.startswith("else"):
            depth -= 1
        pad = "    " * depth
        if test := re.fullmatch(r"(if|elseif) (.*) then", line):
            found.append(f"{pad}{test[1].replace('elseif', 'elif')} _truth({expression(test[2])}):")
        elif line == "else":
            found.append(f"{pad}else:")
        elif loop := re.fullmatch(r"for (\w+) in (.*) loop", line):
            assert loop[1] not in kinds
            parts = ", ".join(expression(p) for p in loop[2].split(":"))
            found.append(f"{pad}for {loop[1]} in _span({parts}):")
        elif several := re.fullmatch(r"\((.*)\) := (.*);", line):
            found.append(f"{pad}{several[1]} = {expression(several[2])}")
        else:
            target, value = re.fullmatch(r"(\w+(?:\[.*?\])?) := (.*);", line).groups()
            name, _, at = target.partition("[")
            value = f"_fits('{kinds[name]}', {expression(value)})"
            if at:
                found.append(f"{pad}{name}[_set_place({name}, {expression(at[:-1])})] = {value}")
            else:
                found.append(f"{pad}{name} = {value}")
        depth += line.endswith((" then", " loop")) or line == "else"
    assert depth == 1
    return found


def _set_place(row, k):
    assert isinstance(k, int)
    assert 1 <= k <= len(row)
    return k - 1


def function(lines):
    """The Python of a function, from its lines."""
    name, split = re.match(r"function (\w+)", lines[0])[1], lines.index("algorithm")
    inputs, outputs, kinds, begin = [], [], {}, []
    for line in lines[1:split]:
        if line == "protected":
            continue
        role, kind, each, size, _, value = DECLARED.fullmatch(line).groups()
        kinds[each] = kind
        if role == "input":
            inputs.append(each)
            if size and size != ":":
                begin.append(f"    assert len({each}) == {size}")
            begin.append(f"    {each} = _fits('{kind}', {each})")
            continue
        outputs += [each] * (role == "output")
        if value:
            begin.append(f"    {each} = {expression(value)}")
        elif size:
            begin.append(f"    {each} = [None] * {size}")
    body = statements(lines[split + 1 : -1], kinds)
    result = ", ".join(outputs)
    assert lines[-1] == f"end {name};"
    return "\n".join([f"def {name}({', '.join(inputs)}):", *begin, *body, f"    return {result}"])


class Values:
    """A record."""


class Model:
    """A model that was read: `run` gives y of u."""

    def __init__(self, text):
        lines = [line for raw in text.splitlines() if (line := raw.partition("//")[0].strip())]
        self.name = re.match(r"model (\w+) \"[^\"]*\"", lines[0])[1]
        assert lines[-1] == f"end {self.name};"
        self.space = {
            **BUILT_IN,
            **{f.__name__: f for f in (_fits, _truth, _number, _place, _set_place, _span, _divided)},
        }
        self.kinds, self.start, self.parameters = {}, {}, {}
        records, rest, k = {}, [], 1
        while k < len(lines) - 1:
            line = lines[k]
            if opened := re.match(r"(function|record) (\w+)", line):
                end = lines.index(f"end {opened[2]};", k)
                if opened[1] == "function":
                    exec(function(lines[k : end + 1]), self.space)
                else:
                    records[opened[2]] = [DECLARED.fullmatch(row) for row in lines[k + 1 : end]]
                k = end + 1
                continue
            rest.append(line)
            k += 1
        split, end = rest.index("algorithm"), rest.index("equation")
        for line in rest[:split]:
            if line != "protected" and not line.startswith("connector"):
                self.declare(DECLARED.fullmatch(line), records)
        (self.sampling,) = re.fullmatch(r"when sample\(0.0, (\w+)\) then", rest[split + 1]).groups()
        assert rest[end - 1] == "end when;"
        names = ", ".join(self.start)
        body = statements(rest[split + 2 : end - 1], self.kinds)
        (equation,) = rest[end + 1 :]
        ends = expression(re.fullmatch(r"y = (.*);", equation)[1])
        code = [
            f"def sampled(u, _old, {names}):",
            *body,
            f"    return {ends}, dict({', '.join(f'{n}={n}' for n in self.start)})",
        ]
        exec("\n".join(code), self.space)

    def declare(self, found, records):
        role, kind, name, size, attributes, value = found.groups()
        self.kinds[name] = kind
        if kind in records:
            assert role == "parameter"
            self.space[name] = Values()
            for row in records[kind]:
                setattr(self.space[name], row[3], eval(expression(row[6])))
                self.parameters[f"{name}.{row[3]}"] = row
        elif value:
            self.space[name] = eval(expression(value))
            self.parameters |= {name: found} if role == "parameter" else {}
        elif role == "discrete":
            first = {"0.0": 0.0, "false": False}[re.search(r"start = ([\w.]+)", attributes)[1]]
            assert "fixed = true" in attributes
            self.start[name] = [first] * int(size) if size else first

    def run(self, u):
        """y (N, ny) or (N,) of u (N, nu) or (N,)."""
        now, found = dict(self.start), []
        for sample in np.asarray(u, dtype=float).tolist():
            y, now = self.space["sampled"](sample, now, **now)
            found.append(y)
        return np.array(found)
