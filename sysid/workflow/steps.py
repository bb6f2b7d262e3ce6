"""What to do after a result: a reason, a command, and what the command brings."""

from dataclasses import dataclass, field
from typing import Any

from sysid.base.quantities import number, percent


@dataclass(frozen=True)
class Gain:
    """What a step brought when it was tried: its fit [%], `instead` of the result's on the same samples.

    Where both are not fits of a free run to the validation data, `of` says of what. A search that its time ended had
    this fit `after` so many seconds; all of it lowers the loss of the estimation data, and may do worse on others.
    `fewer` are the free parameters that the step has less.
    """

    fit: float
    instead: float
    of: str = ""
    after: float | None = None
    fewer: int = 0

    def in_words(self) -> str:
        """Such as "99.3 % instead of 70.5 %"; of a smaller model that has no better fit also what is simpler."""
        fit, instead = percent(self.fit), percent(self.instead)
        after = "" if self.after is None else f"after {number(self.after, 2)} s of its search"
        simpler = f"with {self.fewer} parameter{'s' if self.fewer > 1 else ''} fewer" if self.fewer > 0 else ""
        if simpler and fit == instead:
            words = [self.of, "the same fit", simpler, after]
        else:
            words = [self.of, fit, after, "instead of", instead, "" if self.fit > self.instead else simpler]
        return " ".join(filter(None, words))


@dataclass(frozen=True)
class NextStep:
    """The reason for another step, and its command; `gain` is None where it was not tried, and `missed` says why.

    `change` are the arguments of `sysid.workflow.changes.command` that made the command, by which it can be tried;
    empty where nothing can be. A `guess` has no evidence in the record, and is said only where it was tried.
    """

    why: str
    command: str
    change: dict[str, Any] = field(default_factory=dict, repr=False)
    guess: bool = False
    gain: Gain | None = None
    missed: str = ""

    def line(self, first: str) -> str:
        """The command behind the word `first` and what it brings, or why that is not known."""
        words = self.gain.in_words() if self.gain else self.missed and f"not tried, {self.missed}"
        return f"{first}{f', {words}' if words else ''}: {self.command}"

    def as_dict(self) -> dict[str, Any]:
        """Reason, command and gain, ready for JSON."""
        g = self.gain
        gain = None if g is None else {"fit_percent": g.fit, "instead_of": g.instead, "after_s": g.after}
        return {"why": self.why, "command": self.command, "gain": gain}
