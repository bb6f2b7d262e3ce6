"""The sections and pictures of the page of imperfections, made from the twin at each build."""

from pathlib import Path
from typing import TYPE_CHECKING

from sysid.base.style import png
from twin.report.signatures import draw, markdown
from twin.signatures import signatures

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def write(app: "Sphinx") -> None:
    """`sections.md` and a picture beside it for each signature."""
    folder = Path(app.srcdir) / "generated" / "imperfections"
    folder.mkdir(parents=True, exist_ok=True)
    all_signatures = signatures()
    for signature in all_signatures:
        (folder / f"{signature.key}.png").write_bytes(png(draw(signature)))
    (folder / "sections.md").write_text(markdown(all_signatures), encoding="utf-8")


def setup(app: "Sphinx") -> None:
    app.connect("builder-inited", write, priority=100)
