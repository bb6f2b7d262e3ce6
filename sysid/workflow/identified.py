"""The result of identifying a file: the record, the evaluated model, and the next step."""

from dataclasses import dataclass
from typing import Any

from sysid.base.versions import versions
from sysid.diagnosis.advice import Advice
from sysid.selection.table import Selection
from sysid.workflow.evaluation import Evaluation
from sysid.workflow.record import Record
from sysid.workflow.records import Plan


@dataclass(frozen=True)
class NextStep:
    """The reason for another step, and its command."""

    why: str
    command: str

    def sentence(self) -> str:
        """Both as text for the report and the console."""
        return f"Next: {self.why}; try: {self.command}"


@dataclass(frozen=True)
class Identification:
    """The record with its diagnosis, the plan by which it was prepared and split, and the model with its tests.

    `selection` is the structure search that gave the model, None if the structure was given. `next` is the next step,
    None if the fit is good.
    """

    record: Record
    plan: Plan
    evaluation: Evaluation
    advice: tuple[Advice, ...] = ()
    selection: Selection | None = None
    next: NextStep | None = None

    @property
    def split(self) -> float:
        """The share of the record that is estimation data."""
        return self.plan.split

    @property
    def detrend(self) -> str:
        """What was removed."""
        return self.plan.detrend

    def as_dict(self) -> dict[str, Any]:
        """The summary of `qpal identify`, ready for JSON."""
        return {
            "read": {**self.record.as_dict(), **self._prepared()},
            **self.evaluation.as_dict(),
            "selection": self.selection.as_dict() if self.selection else None,
            "advice": [vars(a) for a in self.advice],
            "next": vars(self.next) if self.next else None,
            "versions": versions(),
        }

    def _prepared(self) -> dict[str, Any]:
        """How the record was prepared and split; what was not asked for is left out."""
        plan, other = self.plan, self.plan.validation
        found: dict[str, Any] = {"split": plan.split if other is None else None, "detrend": plan.detrend}
        if plan.preparation.options():
            found["prepared"] = list(plan.preparation.options())
        if other is not None:
            found["validation"] = other.as_dict()
        return found
