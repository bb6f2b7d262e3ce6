"""Whether the output of a step hangs on the input of the same sample."""

from collections.abc import Callable

from sysid.block.compiler.ir import Ago, Assign, Body, Break, Expr, For, If, Return, Var, statements, walk


def feeds(step: Body, span: Callable[[Expr], tuple[int, int]]) -> bool:
    """Follow the input through the statements in their order; `span` bounds how far an `Ago` looks back.

    What is set under a condition that the input decides counts as decided by it, so that True may be said once too
    often, and False never.
    """
    return _Follower(span).passes(step, set(), False)


class _Follower:
    def __init__(self, span: Callable[[Expr], tuple[int, int]]) -> None:
        self.span, self.left = span, False  # whether the input has decided about a break, or a return

    def hangs(self, e: Expr, wet: set[Var]) -> bool:
        return any(
            each in wet if isinstance(each, Var) else isinstance(each, Ago) and self.span(each.n)[0] <= 0
            for each in walk(e)
        )

    def passes(self, body: Body, wet: set[Var], decided: bool) -> bool:
        """Whether a return gives what hangs on the input; `wet` are the variables that do, and grows."""
        found = False
        for s in body:
            decided = decided or self.left
            if isinstance(s, Assign):
                (wet.add if decided or self.hangs(s.value, wet) else wet.discard)(s.target)
            elif isinstance(s, Return):
                found, self.left = found or decided or self.hangs(s.value, wet), self.left or decided
            elif isinstance(s, Break):
                self.left = self.left or decided
            elif isinstance(s, If):
                inner, other = decided or self.hangs(s.test, wet), set(wet)
                found = self.passes(s.body, wet, inner) or found
                found = self.passes(s.orelse, other, inner) or found
                wet |= other
            elif isinstance(s, For):
                left, returns = self.left, any(isinstance(each, Return) for each in statements(s.body))
                while True:
                    before = set(wet)
                    found = self.passes(s.body, wet, decided or self.hangs(s.count, wet)) or found
                    wet |= before
                    if wet == before:
                        break
                self.left = self.left if returns else left  # a break ends with its loop
        return found
