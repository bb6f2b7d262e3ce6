"""Update the pictures, the table of sizes and the sections of docs/imperfections.md. Run it after changes to them.

.venv/bin/python scripts/signatures.py
"""

import io
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from twin.report.signatures import MARKS, draw, markdown
from twin.signatures import Signature, signatures

DOCS = Path(__file__).resolve().parent.parent / "docs"
DPI = 200
COLOURS = 64  # a palette keeps the pictures small enough to live in the repository


def picture(signature: Signature) -> Image.Image:
    """A signature picture with few colours."""
    buffer = io.BytesIO()
    figure = draw(signature)
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png", dpi=DPI)
    return Image.open(buffer).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)


def main() -> None:
    """Update the pictures and the page below its introduction."""
    all_signatures = signatures()
    for signature in all_signatures:
        picture(signature).save(DOCS / f"imperfections-{signature.key}.png", optimize=True)
    page = DOCS / "imperfections.md"
    introduction = page.read_text(encoding="utf-8").partition(MARKS[0])[0]
    page.write_text(introduction + markdown(all_signatures), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
