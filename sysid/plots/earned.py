"""By how much each part that was tried lowered BIC in the growth of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.base import style
from sysid.base.checks import checked
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Bars, Figure, Panel, Rule

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Bar = tuple[str, float, bool, bool]  # name of the part, fall of BIC, kept in its round, still in the final joint
LINEAR = 10.0  # [BIC] below which a fall is drawn to scale


@checked(deferred=("axes",))
def earned(rounds: Sequence[Sequence[Bar]], margin: float, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """One panel for each round: a bar to the right of the dashed line earned its place, and the filled one stayed.

    A hatched bar is a part that was kept in its round and dropped at the end.
    """
    return draw(earned_figure(rounds, margin), axes)


def earned_figure(rounds: Sequence[Sequence[Bar]], margin: float, texts: Sequence[Sequence[str]] = ()) -> Figure:
    """A panel for each round; `texts` of its bars stand in the hover."""
    x = Axis(f"fall of BIC, logarithmic beyond {LINEAR:g} [1]", log=True, linear_below=LINEAR)
    rules = [Rule(0.0), Rule(margin, dash="dash", colour=style.INK)]
    panels = [
        Panel(
            [
                Bars(
                    [fall for _, fall, *_ in bars],
                    filled=[stayed for *_, stayed in bars],
                    hatched=[kept and not stayed for *_, kept, stayed in bars],
                    texts=texts[k] if texts else (),
                ),
                *rules,
            ],
            Axis(names=[name for name, *_ in bars]),
            x,
            f"round {k + 1}",
        )
        for k, bars in enumerate(rounds)
    ]
    return Figure(panels, max(len(panels), 1), shared=False, height=2.8)
