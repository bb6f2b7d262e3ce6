"""Read a step, a small subset of Python, into `ir`; anything else raises an error with line and remedy."""

import ast

from sysid.base.errors import InputError
from sysid.block.compiler.checks import LONGEST, Facts, check_depth, whole_count
from sysid.block.compiler.ir import (
    Ago,
    Assign,
    Body,
    Break,
    Const,
    Expr,
    For,
    If,
    Num,
    Param,
    Program,
    Return,
    Stmt,
    Var,
    expressions,
    statements,
)
from sysid.block.compiler.phrases import (
    ARITHMETIC,
    DEEPEST,
    HINT,
    LARGEST,
    Frame,
    Phrases,
    Row,
    leaves,
    variables,
)


def read(text: str, main: str = "step") -> Program:
    """The program of a module text with `step(s, x, p)` and, if it has one, `begin(s, x, p)`; both may take the block.

    s holds the states (s.speed), x is the input, p the parameters (p.gain, p.rise[i]), the block its structure.
    A map's `main` is its value(x, p), without states.
    """
    try:
        program = _Reader(text, main).program()
        check_depth(program)
    except RecursionError:
        raise InputError("the step's text nests too deep; split its expressions") from None
    return program


class _Reader(Phrases):
    def __init__(self, text: str, main: str) -> None:
        self.text, self.main = text, main
        try:
            tree = ast.parse(text)
        except SyntaxError as e:
            raise InputError(f"line {e.lineno} of the step's text is not valid Python ({e.msg}); correct it") from None
        except (ValueError, MemoryError) as e:  # a null byte, or far too many brackets
            raise InputError(f"the step's text is not valid Python ({e}); correct it") from None
        self.size = 0
        self.beginning = False
        self.uses = []
        self.functions: dict[str, ast.FunctionDef] = {}
        self.numbers: dict[str, float] = {}
        for node in tree.body:
            self._top(node)
        self.states: dict[str, None] = {}
        self.taken: set[str] = set()

    def _top(self, node: ast.stmt) -> None:
        names = [t.id for t in getattr(node, "targets", []) if isinstance(t, ast.Name)]
        for name in [node.name] if isinstance(node, ast.FunctionDef) else names:
            if name in self.functions or name in self.numbers:
                raise InputError(f"line {node.lineno} of the step's text defines {name} a second time; rename one")
        if isinstance(node, ast.FunctionDef):
            self.functions[node.name] = node
        elif isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            try:
                value = ast.literal_eval(node.value)
            except (ValueError, TypeError):
                value = None
            if not isinstance(value, (int, float)):
                raise InputError(
                    f"line {node.lineno} of the step's text assigns no number to {node.targets[0].id}; give a number"
                )
            if isinstance(value, int) and abs(value) > LARGEST:
                raise InputError(
                    f"line {node.lineno} of the step's text has a whole number beyond 2**31 - 1; write {HINT} for it"
                )
            self.numbers[node.targets[0].id] = value
        elif not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            raise InputError(
                f"line {node.lineno} of the step's text is neither a function nor a number with a name; remove it"
            )

    def program(self) -> Program:
        if self.main == "value":
            return self._of((), self._function("value"))
        if "step" not in self.functions:
            raise InputError("the text defines no step; give def step(s, x, p): ... return y")
        self.beginning = True
        begin = self._function("begin") if "begin" in self.functions else ()
        self.beginning = False
        return self._of(begin, self._function("step"))

    def _of(self, begin: Body, step: Body) -> Program:
        self._check_uses((*begin, *step))
        all_expressions = [*expressions(begin), *expressions(step)]
        params = {e.name for e in all_expressions if isinstance(e, Param) and e.index is None}
        rows = {e.name for e in all_expressions if isinstance(e, Param) and e.index is not None}
        if params & rows:
            raise InputError(f"{', '.join(sorted(params & rows))} is used with and without an index; use two names")
        consts = {e.name for e in all_expressions if isinstance(e, Const)}
        names = (tuple(sorted(n)) for n in (params, rows, consts))
        return Program(tuple(self.states), next(names), next(names), next(names), begin, step)

    def _function(self, name: str) -> Body:
        node = self.functions[name]
        names = self._arguments(node)
        wanted = ("x", "p") if name == "value" else ("s", "x", "p")
        if not len(wanted) <= len(names) <= len(wanted) + 1:
            arguments = ", ".join(wanted)
            raise InputError(
                f"{name} takes {len(names)} argument(s); give {name}({arguments}) or {name}({arguments}, block)"
            )
        if name == "value":  # a map has no states
            names = ["", *names]
        kinds = {names[0]: "state", names[2]: "params", **dict.fromkeys(names[3:], "block")}
        values: dict[str, Expr | Row] = {names[1]: Ago(Num(0))}
        frame = Frame(name, self.text, node.lineno, kinds, values, names[1], () if name == "begin" else None)
        body = self._block(frame, node.body)
        if name != "begin" and not _returns(body):
            self._refuse(frame, node, "it does not return on every path; end it with return y")
        self._check(frame, node, body, set())
        return body

    def _check_uses(self, body: Body) -> None:
        facts = Facts(body)
        for f, node, use, e in self.uses:
            if why := facts.against(use, e):
                self._refuse(f, node, why)
        for s in facts.growing():
            raise InputError(
                f"the whole number {s.target.name} grows by products or sums of itself in a loop and may overflow; "
                "begin it with a decimal number, such as 1.0"
            )

    def _arguments(self, node: ast.FunctionDef) -> list[str]:
        a = node.args
        if a.posonlyargs or a.kwonlyargs or a.vararg or a.kwarg or a.defaults or node.decorator_list:
            raise InputError(
                f"{node.name} has decorators, defaults or starred arguments; give plain arguments by place"
            )
        names = [each.arg for each in a.args]
        if len(set(names)) < len(names):
            raise InputError(f"{node.name} has two arguments of one name, {', '.join(names)}; rename one")
        return names

    def _block(self, f: Frame, body: list[ast.stmt]) -> Body:
        out: list[Stmt] = []
        for i, node in enumerate(body):
            rest = body[i + 1 :]
            self.size += 1
            if self.size > LONGEST:
                self._refuse(f, node, f"the step has over {LONGEST} statements with its helpers put in; shorten it")
            if isinstance(node, ast.If) and _has(node, ast.Return):  # what follows belongs into the branches
                self._no_loop(f, node)
                preceding: list[Stmt] = []
                test = self._test(f, node.test, preceding)
                branches = [
                    self._block(f, branch if _always(branch) else [*branch, *rest])
                    for branch in (node.body, node.orelse)
                ]
                return (*out, *preceding, If(test, *branches))
            self._statement(f, node, out)
            if isinstance(node, (ast.Return, ast.Break)):
                if rest:
                    self._refuse(f, rest[0], "nothing gets here")
                break
        return tuple(out)

    def _statement(self, f: Frame, node: ast.stmt, out: list[Stmt]) -> None:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            return
        if isinstance(node, ast.Pass):
            return
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            self._assign(f, node.targets[0], node.value, out)
        elif isinstance(node, ast.AugAssign) and type(node.op) in ARITHMETIC:
            target = ast.copy_location(_load_target(node.target), node)
            self._assign(f, node.target, ast.copy_location(ast.BinOp(target, node.op, node.value), node), out)
        elif isinstance(node, ast.If):
            test = self._test(f, node.test, out)
            branches = self._block(f, node.body), self._block(f, node.orelse)
            if any(branches):
                out.append(If(test, *branches))
        elif isinstance(node, ast.For):
            self._loop(f, node, out)
        elif isinstance(node, ast.Break) and f.looping:
            out.append(Break())
        elif isinstance(node, ast.Return):
            self._return(f, node, out)
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            self._call(f, node.value, (), out)
        else:
            self._refuse(f, node)

    def _assign(self, f: Frame, target: ast.expr, value: ast.expr, out: list[Stmt]) -> None:
        targets = list(target.elts) if isinstance(target, ast.Tuple) else [target]
        names = tuple(self._target(f, t) for t in targets)
        if isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id in self.functions:
            fresh = tuple(n if not n.state and len(names) == 1 else Var(self._fresh(n.name)) for n in names)
            self._call(f, value, fresh, out)
            out.extend(Assign(n, v) for n, v in zip(names, fresh, strict=True) if n != v)
            return
        values = list(value.elts) if isinstance(value, ast.Tuple) else [value]
        if len(values) != len(names):
            self._refuse(f, target, f"{len(names)} names for {len(values)} values")
        expressions_read = [self._expr(f, v, out) for v in values]
        read = {e for v in expressions_read[1:] for e in variables(v)}
        if read & set(names[:-1]):  # as Python has it: all values first
            temporary = [Var(self._fresh(n.name)) for n in names]
            out.extend(Assign(t, v) for t, v in zip(temporary, expressions_read, strict=True))
            expressions_read = list(temporary)
        out.extend(Assign(n, v) for n, v in zip(names, expressions_read, strict=True))

    def _target(self, f: Frame, node: ast.expr) -> Var:
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if f.kinds.get(node.value.id) == "state":
                self.states[node.attr] = None
                return Var(node.attr, True)
            self._refuse(f, node, "only states (s.name) and names of your own can be set")
        if not isinstance(node, ast.Name):
            self._refuse(f, node, "only states (s.name) and names of your own can be set")
        if node.id in f.indices:
            self._refuse(f, node, f"{node.id} counts the loop; give the value another name")
        if node.id in f.kinds or (node.id == f.input):
            self._refuse(f, node, f"{node.id} is an argument; give the value another name")
        f.values.pop(node.id, None)
        return self._local(f, node.id)

    def _local(self, f: Frame, name: str) -> Var:
        if name not in f.locals:
            f.locals[name] = self._fresh(name)
        return Var(f.locals[name])

    def _loop(self, f: Frame, node: ast.For, out: list[Stmt]) -> None:
        call = node.iter
        ranged = isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"
        if not ranged or len(call.args) != 1 or node.orelse or not isinstance(node.target, ast.Name):  # type: ignore[attr-defined]
            self._refuse(f, node, "a loop is for name in range(n) without else")
        self._no_return(f, node)
        count = self._expr(f, call.args[0], out)  # type: ignore[attr-defined]
        if not all(isinstance(e, (Num, Const)) for e in leaves(count)) or not whole_count(count):
            self._refuse(f, node, "the number of loop passes must be a number or a value of the block's structure")
        name = node.target.id
        if name in f.kinds or name == f.input or (name in f.indices and name != "_"):
            self._refuse(f, node, f"{name} is an argument or counts a loop around this one; rename it")
        index = self._fresh("k" if name == "_" else name)
        outer_indices, f.indices = f.indices, (*f.indices, name)
        f.values.pop(name, None)
        f.locals[name] = index
        f.looping += 1
        body = self._block(f, node.body)
        f.looping -= 1
        f.indices = outer_indices
        f.locals.pop(name, None)  # its last value is gone
        if body:
            out.append(For(index, count, body))

    def _return(self, f: Frame, node: ast.Return, out: list[Stmt]) -> None:
        self._no_loop(f, node)
        values = [] if node.value is None else node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
        if f.results is None:
            if len(values) != 1:
                self._refuse(f, node, "a step returns one output")
            out.append(Return(self._alone(f, values[0], out)))
            return
        if not f.results:  # called for what it sets
            for v in values:
                self._alone(f, v, out)
            return
        if len(values) != len(f.results):
            self._refuse(f, node, f"{f.name} returns {len(values)} value(s) where {len(f.results)} are needed")
        results = [self._alone(f, values[0], out)] if len(values) == 1 else [self._expr(f, v, out) for v in values]
        out.extend(Assign(r, v) for r, v in zip(f.results, results, strict=True))

    def _alone(self, f: Frame, node: ast.expr, out: list[Stmt]) -> Expr:
        """The one value of a statement; a helper that sets states may give it."""
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in self.functions:
            return self._function_of(f, node, out, whole=True)
        return self._expr(f, node, out)

    def _call(self, f: Frame, node: ast.Call, results: tuple[Var, ...], out: list[Stmt]) -> None:
        """A helper's body in place of its call."""
        if not isinstance(node.func, ast.Name) or node.func.id not in self.functions or node.keywords:
            self._refuse(f, node)
        helper = self.functions[node.func.id]
        names = self._arguments(helper)
        if len(names) != len(node.args) or f.depth > DEEPEST:
            self._refuse(f, node, f"{helper.name} takes {len(names)} arguments and may not call itself")
        sets_states = any(isinstance(a, ast.Name) and f.kinds.get(a.id) == "state" for a in node.args)
        set_inside = {n.id for n in ast.walk(helper) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        inner = Frame(helper.name, self.text, helper.lineno, {}, {}, None, results, {}, f.depth + 1)
        for name, arg in zip(names, node.args, strict=True):
            if isinstance(arg, ast.Name) and arg.id in f.kinds:
                inner.kinds[name] = f.kinds[arg.id]
                continue
            if isinstance(arg, ast.Attribute) and self._kind(f, arg) == "params":
                inner.values[name] = arg.attr  # a parameter, or a row of them: its use decides
                continue
            value = self._expr(f, arg, out)
            if isinstance(arg, ast.Name) and arg.id == f.input:
                inner.input = name
            moves = name in set_inside or (sets_states and any(v.state for v in variables(value)))
            if (isinstance(value, (Num, Const, Param, Var)) and not moves) or (
                isinstance(value, Ago) and value.n == Num(0) and name not in set_inside
            ):
                inner.values[name] = value
            else:
                inner.locals[name] = self._fresh(name)
                out.append(Assign(Var(inner.locals[name]), value))
        body = self._block(inner, helper.body)
        if results and not _sets(body, results):
            self._refuse(inner, helper, "it does not return on every path")
        out.extend(body)

    def _check(self, f: Frame, node: ast.AST, body: Body, known: set[Var]) -> set[Var]:
        """Checks that every name has a value on every path to its use; returns the names known at the end."""
        for s in body:
            reads = (s.value,) if isinstance(s, (Assign, Return)) else (s.test,) if isinstance(s, If) else ()
            for v in (v for e in reads for v in variables(e)):
                if not v.state and v not in known:
                    self._refuse(f, node, f"{v.name} may be read before it has a value")
            if isinstance(s, Assign):
                known = known | {s.target}
            elif isinstance(s, If):
                a, b = self._check(f, node, s.body, known), self._check(f, node, s.orelse, known)
                known = b if _breaks(s.body) else a if _breaks(s.orelse) else a & b
            elif isinstance(s, For):
                self._check(f, node, s.body, known | {Var(s.index)})
        return known

    def _no_loop(self, f: Frame, node: ast.stmt) -> None:
        if f.looping:
            self._refuse(f, node, "a return does not stand in a loop; leave the loop with break first")

    def _no_return(self, f: Frame, node: ast.stmt) -> None:
        for inner in ast.walk(node):
            if isinstance(inner, ast.Return):
                self._refuse(f, inner, "a return does not stand in a loop; leave the loop with break first")


def _load_target(node: ast.expr) -> ast.expr:
    """The target of += as a value."""
    if isinstance(node, ast.Name):
        return ast.copy_location(ast.Name(node.id, ast.Load()), node)
    if isinstance(node, ast.Attribute):
        return ast.copy_location(ast.Attribute(node.value, node.attr, ast.Load()), node)
    return node


def _has(node: ast.AST, kind: type) -> bool:
    return any(isinstance(n, kind) for n in ast.walk(node))


def _always(body: list[ast.stmt]) -> bool:
    """Whether every path through these statements returns or breaks."""
    if not body:
        return False
    last = body[-1]
    return isinstance(last, (ast.Return, ast.Break)) or (
        isinstance(last, ast.If) and _always(last.body) and _always(last.orelse)
    )


def _returns(body: Body) -> bool:
    if not body:
        return False
    last = body[-1]
    return isinstance(last, Return) or (isinstance(last, If) and _returns(last.body) and _returns(last.orelse))


def _breaks(body: Body) -> bool:
    if not body:
        return False
    last = body[-1]
    return isinstance(last, (Break, Return)) or (isinstance(last, If) and _breaks(last.body) and _breaks(last.orelse))


def _sets(body: Body, results: tuple[Var, ...]) -> bool:
    """Whether the last statement of every path gives the results a value."""
    if not body:
        return False
    last = body[-1]
    if isinstance(last, If):
        return _sets(last.body, results) and _sets(last.orelse, results)
    return any(isinstance(s, Assign) and s.target == results[0] for s in statements(body))
