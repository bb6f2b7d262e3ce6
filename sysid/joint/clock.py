"""A time that a search of several stages may take: a stage that it ends or leaves no place for is told, by name."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


class TimeIsUp(Exception):  # noqa: N818 - reads as what it says
    """The time is over; `Clock.within` catches it at the stage that it ends."""


@dataclass
class Clock:
    """`seconds` from now on; `left` are the stages that the time ended or left no place for, in order."""

    seconds: float = np.inf
    left: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._deadline = time.monotonic() + self.seconds

    @property
    def late(self) -> bool:
        """Whether the time is over."""
        return time.monotonic() > self._deadline

    def hears(self, progress: Callable[[str], None] | None) -> Callable[[str], None] | None:
        """A progress that raises TimeIsUp after the first search that ends too late.

        A search is short, and every fit tells each of its searches; so no fit has to know of the clock.
        """
        if self.seconds == np.inf:
            return progress

        def tell(text: str) -> None:
            if progress is not None:
                progress(text)
            if self.late:
                raise TimeIsUp

        return tell

    def within(self, stage: str, work: Callable[..., T], otherwise: T, *args: Any) -> T:
        """The result of `work(*args)`, or `otherwise` where the time does not suffice for this stage."""
        if not self.late:
            try:
                return work(*args)
            except TimeIsUp:
                pass
        self.left.append(stage)
        return otherwise

    def sentence(self) -> str:
        """What the time left out, and what to do; empty if nothing."""
        if not self.left:
            return ""
        *first_stages, last = dict.fromkeys(self.left)
        stages = f"{', '.join(first_stages)} and {last}" if first_stages else last
        return (
            f"the search was stopped after {self.seconds:g} s, before {stages}: a better "
            f"joint may exist; give it more time, for example --seconds {2.0 * self.seconds:g}"
        )
