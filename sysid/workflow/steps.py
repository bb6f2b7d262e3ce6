"""What to do after a result: a reason, a command, and what the command brings."""

from dataclasses import dataclass, field
from typing import Any

from sysid.base.quantities import percent


@dataclass(frozen=True)
class Gain:
    """What a step brought when it was tried: its fit [%], `instead` of the result's on the same samples.

    Where both are not fits of a free run to the validation data, `of` says of what. A search that its time ended has
    `at_least` this fit.
    """

    fit: float
    instead: float
    of: str = ""
    at_least: bool = False

    def in_words(self) -> str:
        """Such as "99.3 % instead of 70.5 %"."""
        fit = f"{'at least ' if self.at_least else ''}{percent(self.fit)}"
        return f"{self.of} {fit} instead of {percent(self.instead)}".lstrip()


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
        gain = None if self.gain is None else {"fit_percent": self.gain.fit, "instead_of": self.gain.instead}
        return {"why": self.why, "command": self.command, "gain": gain}
