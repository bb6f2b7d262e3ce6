"""The C99 of a block as a tree, for languages that it is written in again with its parameters still variable.

`CCode` is the neutral form of a block whose parameters have names: the library writes it itself, so that a few
statements and expressions are all of it. What is beyond them is refused, never guessed.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import cast

from sysid.base.errors import InputError

KINDS = ("double", "long", "int")  # numbers, whole numbers, and truths: int has no other use but in the head of a loop
_TOKEN = re.compile(
    r"\s*(?:/\*.*?\*/\s*)*(\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+|\d+|\w+|->|&&|\|\||[-+=!<>]=|\+\+|--|\S)", re.S
)
_LEVELS = (("||",), ("&&",), ("==", "!="), ("<", "<=", ">", ">="), ("+", "-"), ("*", "/"))


@dataclass(frozen=True)
class Num:
    """A number; a whole one is an int."""

    value: float


@dataclass(frozen=True)
class Ref:
    """A variable, or one of an array: a local one, or one of the struct of states ("s") or parameters ("p")."""

    of: str
    name: str
    index: "Expr | None" = None


@dataclass(frozen=True)
class Op:
    """An operator, "?" of three, "neg", a cast to one of `KINDS`, or a function by its name."""

    op: str
    args: tuple["Expr", ...]


Expr = Num | Ref | Op


@dataclass(frozen=True)
class Declare:
    """A local variable, or with a length an array; without values it is set later."""

    kind: str
    name: str
    length: int | None
    values: tuple[Expr, ...]


@dataclass(frozen=True)
class Set:
    target: Ref
    value: Expr


@dataclass(frozen=True)
class If:
    test: Expr
    body: tuple["Stmt", ...]
    orelse: tuple["Stmt", ...]


@dataclass(frozen=True)
class For:
    index: str
    over: range
    body: tuple["Stmt", ...]


@dataclass(frozen=True)
class Break:
    pass


@dataclass(frozen=True)
class Return:
    value: Expr


Stmt = Declare | Set | If | For | Break | Return
Body = tuple[Stmt, ...]


def tree(text: str) -> Body:
    """The statements of a body, see `structured`.

    Raises InputError for what is beyond the language.
    """
    return structured(_Reader(text).body())


def statements(body: Body) -> Iterator[Stmt]:
    """All statements, nested ones included."""
    for s in body:
        yield s
        if isinstance(s, If):
            yield from statements(s.body + s.orelse)
        elif isinstance(s, For):
            yield from statements(s.body)


def leaves_loop(body: Body) -> bool:
    """Whether a break among these statements ends the loop around them, or a return the function."""
    return any(isinstance(s, (Break, Return)) or (isinstance(s, If) and leaves_loop(s.body + s.orelse)) for s in body)


def structured(body: Body) -> Body:
    """The same without a statement behind a branch that leaves its loop or the function: it stands in the branches."""
    found: list[Stmt] = []
    for k, s in enumerate(body):
        if isinstance(s, If):
            rest = body[k + 1 :] if leaves_loop((s,)) else ()
            s = If(s.test, structured(s.body + rest), structured(s.orelse + rest))
        elif isinstance(s, For):
            s = For(s.index, s.over, structured(s.body))
        found.append(s)
        if isinstance(s, (Break, Return)) or leaves_loop((s,)):
            break
    return tuple(found)


def targets(body: Body) -> set[tuple[str, str]]:
    """All that is set, as (struct or "", name)."""
    return {(s.target.of, s.target.name) for s in statements(body) if isinstance(s, Set)}


class _Reader:
    """Tokens of a text, taken from the front."""

    def __init__(self, text: str) -> None:
        self.tokens, self.at = _TOKEN.findall(text), 0

    def peek(self) -> str:
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def take(self, wanted: str = "") -> str:
        token = self.peek()
        if not token or (wanted and token != wanted):
            raise self.refusal()
        self.at += 1
        return cast(str, token)

    def taken(self, *words: str) -> bool:
        """Whether these words come next, which are then behind."""
        found = tuple(self.tokens[self.at : self.at + len(words)]) == words
        self.at += len(words) * found
        return found

    def refusal(self) -> InputError:
        near = " ".join(self.tokens[max(self.at - 3, 0) : self.at + 5])
        return InputError(f"{near!r} of the exported C cannot be written in this language; export with --c or --fmu")

    # Statements

    def body(self) -> Body:
        found: list[Stmt] = []
        while self.peek() and self.peek() != "}":
            found += self.statement()
        return tuple(found)

    def block(self) -> Body:
        if not self.taken("{"):
            return self.statement()
        body = self.body()
        self.take("}")
        return body

    def statement(self) -> Body:
        if self.taken("(", "void", ")"):
            self.at += 2
            return ()
        if self.taken("if", "("):
            test = self.expression()
            self.take(")")
            body = self.block()
            return (If(test, body, self.block() if self.taken("else") else ()),)
        if self.taken("for", "(", "int"):
            return (self.loop(),)
        constant = self.taken("const")
        found: Stmt
        if self.peek() in KINDS:
            found = self.declaration()
        elif constant:
            raise self.refusal()
        elif self.taken("break"):
            found = Break()
        elif self.taken("return"):
            found = Return(self.expression())
        else:
            found = self.assignment()
        self.take(";")
        return (found,)

    def loop(self) -> For:
        index = self.take()
        self.take("=")
        first = self.take()
        self.take(";")
        self.take(index)
        up = self.take() == "<"
        last = self.take()
        self.take(";")
        self.take("++" if up else "--")
        self.take(index)
        self.take(")")
        return For(index, range(int(first), int(last), 1 if up else -1), self.block())

    def declaration(self) -> Declare:
        kind, name, length = self.take(), self.take(), None
        if self.taken("["):
            length = int(self.take())
            self.take("]")
        if not self.taken("="):
            return Declare(kind, name, length, ())
        if length is None:
            return Declare(kind, name, None, (self.expression(),))
        self.take("{")
        values = self.several("}")
        return Declare(kind, name, length, values)

    def assignment(self) -> Set:
        target = self.unary()
        if not isinstance(target, Ref):
            raise self.refusal()
        sign = self.take()
        if sign not in ("=", "+=", "-="):
            raise self.refusal()
        value = self.expression()
        return Set(target, value if sign == "=" else Op(sign[0], (target, value)))

    def several(self, end: str) -> tuple[Expr, ...]:
        """Expressions between commas."""
        found = [] if self.peek() == end else [self.expression()]
        while self.taken(","):
            found.append(self.expression())
        self.take(end)
        return tuple(found)

    # Expressions

    def expression(self) -> Expr:
        test = self.binary(0)
        if not self.taken("?"):
            return test
        first = self.expression()
        self.take(":")
        return Op("?", (test, first, self.expression()))

    def binary(self, level: int) -> Expr:
        if level == len(_LEVELS):
            return self.unary()
        left = self.binary(level + 1)
        while self.peek() in _LEVELS[level]:
            left = Op(self.take(), (left, self.binary(level + 1)))
        return left

    def unary(self) -> Expr:
        for sign, op in (("-", "neg"), ("!", "!"), ("&", "&")):
            if self.taken(sign):
                return Op(op, (self.unary(),))
        for kind in KINDS:
            if self.taken("(", kind, ")"):
                return Op(kind, (self.unary(),))
        if self.taken("("):
            inner = self.expression()
            self.take(")")
            return inner
        token = self.take()
        if token[0].isdigit():
            return Num(int(token) if token.isdigit() else float(token))
        if token == "INFINITY":
            return Num(float("inf"))
        if not token[0].isalpha() and token[0] != "_":
            raise self.refusal()
        if self.taken("("):
            return Op(token, self.several(")"))
        of, name = (token, self.take()) if self.taken("->") else ("", token)
        if not self.taken("["):
            return Ref(of, name)
        index = self.expression()
        self.take("]")
        return Ref(of, name, index)
