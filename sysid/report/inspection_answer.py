"""The first screen of `qpal info FILE`: how the file is read, what of it is in doubt, and the next command."""

from sysid.base.quantities import capital, display_quantity, number
from sysid.channels.roles import NONE_LEFT
from sysid.channels.signals import Signals
from sysid.diagnosis.relation import without_effect
from sysid.report.answer import GOOD, POOR, USABLE, Answer, Word
from sysid.report.page import Grid, Picture
from sysid.workflow.inspection import Inspection


def answer(result: Inspection, picture: Picture | None) -> Answer:
    """The first screen, with the `picture` of the channels where there is a record."""
    s, n = result.signals, len(result.columns)
    if s is None:
        size, of = f"{n} column{'s' * (n != 1)}", "in the file, which is not read as a record yet"
    else:
        size, of = f"{s.N} samples", f"read from {n} columns, one every {s.Ts:.4g} s"
    return Answer(
        size, of, word(result), sentence(result), picture, values=values(s) if s else None, next=following(result)
    )


def word(result: Inspection) -> Word:
    """Poor where nothing can be identified from it as it is; good where nothing is in doubt, repaired or warned of."""
    if result.signals is None or result.obstacle or without_effect(result.advice) is not None:
        return POOR
    doubts = (*result.unclear, result.problem, *_warnings(result), *_repairs(result.signals))
    return USABLE if any(doubts) else GOOD


def sentence(result: Inspection) -> str:
    """What is in the way, else the first doubt and how many more there are."""
    in_the_way = (*result.unclear, result.problem, result.obstacle)
    if first := next(filter(None, in_the_way), ""):
        said = _finding(first)
        return f"{said if said.startswith(str(result.path)) else capital(said)}."
    doubts = [*_warnings(result), *(_repairs(result.signals) if result.signals else ())]
    if not doubts:
        return "Clock, input and output are beyond doubt, and nothing was repaired."
    more = f" ({len(doubts) - 1} more below)" if doubts[1:] else ""
    return f"{capital(_finding(doubts[0]))}{more}."


def _finding(text: str) -> str:
    """What was found, without what to do about it; of a log without a signal which, and not its columns."""
    before, lacks, role = text.partition(NONE_LEFT)
    found = before.rpartition("; ")[2] if lacks else before.partition(";")[0]
    return f"{found}{lacks}{role.partition(';')[0]}".rstrip(".")


def _warnings(result: Inspection) -> list[str]:
    return [a.sentence for a in result.advice if a.severity == "warning"]


def _repairs(signals: Signals) -> list[str]:
    """Counts of samples that are not those of the file."""
    counts = {name.replace("_", " "): n for name, n in signals.counts.items() if n}
    return [f"repaired: {', '.join(f'{n} {name}' for name, n in counts.items())}"] if counts else []


def values(signals: Signals) -> Grid:
    """The ranges of the channels, and the length."""
    rows = []
    for role in ("input", "output"):
        for s in getattr(signals, role):
            q = display_quantity(s.name, s.unit)
            seen = s.values[~s.missing] * q.factor
            low, high = (number(float(end)) for end in (seen.min(), seen.max())) if len(seen) else ("–", "–")
            rows.append((f"{role} {q.name}", f"{low} to {high}", q.unit))
    rows = rows[:4]  # of many channels the first
    return Grid(("", "value", "unit"), [*rows, ("length", number(signals.N * signals.Ts), "s")], last_text=True)


def following(result: Inspection) -> str:
    """The next command, and what has to be done before it; no command that is refused."""
    if result.command:
        edit = result.unclear and result.unwritten is None
        first = f"fill in the lines of {result.options[-1]} that say CHOOSE, then: " if edit else ""
        first = f"{result.assumption}: " if result.assumption else first
        return f"Next: {first}{result.command}"
    if result.lack:
        return f"Next: {result.lack}"
    if (none := without_effect(result.advice)) is not None and not result.obstacle:
        return f"Next: {none.action}"
    if not result.obstacle:  # the problem says itself what to do
        todo = result.problem.partition(";")[2].strip()
        return f"Next: {todo}" if todo else ""
    todos = [a.action for a in result.advice if a.topic == "data" and a.severity == "warning" and a.action]
    todo = todos[0] if todos else result.obstacle.rpartition("; ")[2]
    return f"Next: {todo}"
