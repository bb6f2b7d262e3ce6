"""Renew docs/imperfections.md's pictures and its table of sizes. Run it after a change that moves either.

.venv/bin/python scripts/signatures.py
"""

import io
import re
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from sysid.report.page import Grid
from twin.report.signatures import draw, sizes
from twin.signatures import Signature, signatures

DOCS = Path(__file__).resolve().parent.parent / "docs"
MARKS = ("<!-- sizes: made by scripts/signatures.py -->\n", "<!-- end of sizes -->\n")
SHOWN = ("switch", "what is measured", "joint", "measured", "true", "unit")
DPI = 200
COLOURS = 64  # a palette keeps the pictures small enough to live in the repository


def markdown(grid: Grid) -> str:
    """The grid as a Markdown table."""
    rows = [grid.headings, [":--" if grid.is_text(j) else "--:" for j in range(len(grid.headings))], *grid.rows]
    return "".join("| " + " | ".join(row) + " |\n" for row in rows)


def picture(signature: Signature) -> Image.Image:
    """A signature with few colours."""
    buffer = io.BytesIO()
    figure = draw(signature)
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png", dpi=DPI)
    return Image.open(buffer).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)


def main() -> None:
    """Pictures, and the table between the two marks."""
    found = signatures()
    for signature in found:
        picture(signature).save(DOCS / f"imperfections-{signature.key}.png", optimize=True)
    page = DOCS / "imperfections.md"
    new = MARKS[0] + markdown(sizes(found).only(*SHOWN)) + MARKS[1]
    pattern = re.escape(MARKS[0]) + ".*?" + re.escape(MARKS[1])
    page.write_text(re.sub(pattern, lambda _: new, page.read_text(encoding="utf-8"), flags=re.DOTALL), encoding="utf-8")


if __name__ == "__main__":
    main()
