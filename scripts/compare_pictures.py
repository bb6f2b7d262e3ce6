"""Update the pictures of docs/compare.md. Run it after changes to the verdict or to the views.

.venv/bin/python scripts/compare_pictures.py
"""

import io
from pathlib import Path

from PIL import Image

from sysid.base import style
from twin.compare.comparison import twin_response
from twin.compare.search import Trials
from twin.compare.standins import stand_in
from twin.compare.verdict import explain
from twin.follow import Follower
from twin.parameters import Parameters
from twin.report import compare_figures
from twin.view import pictures
from twin.view.replay import Movement, Replay
from twin.view.traces import Traces

DOCS = Path(__file__).resolve().parent.parent / "docs"
SHOWN = ("load", 0)
COLOURS = 64  # a palette keeps the pictures small enough to live in the repository


def save(png: bytes, name: str) -> None:
    """A PNG with few colours."""
    picture = Image.open(io.BytesIO(png)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    picture.save(DOCS / f"compare-{name}.png", optimize=True)


def main() -> None:
    """The strip and the effects of one stand-in."""
    example = stand_in(*SHOWN)
    print(example.joint, example.size)
    comparison = twin_response(example.log, example.joint)
    traces = Traces(example.joint, comparison.t, comparison.u, comparison.y, comparison.twin)
    replay = Replay(
        Movement(comparison.t, {example.joint: comparison.y}), Movement(comparison.t, {example.joint: comparison.twin})
    )
    save(style.png(pictures.strip(replay, pictures.Names("log", "twin"), 6, traces)), "strip")
    verdict = explain(Trials(Follower(example.log, example.joint), Parameters()))
    save(style.png(compare_figures.effects(verdict)), "effects")


if __name__ == "__main__":
    main()
