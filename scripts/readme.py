"""Renew what README shows: the tables of results (seed 0) and docs/leg.png. Run it after a change that moves either.

.venv/bin/python scripts/readme.py
"""

import re
from pathlib import Path

import numpy as np
from PIL import Image

from twin.report import actuated_joint, reproduce
from twin.studies import protocol
from twin.view.stills import leg_stills

ROOT = Path(__file__).resolve().parent.parent
MARK, END = "<!-- {}: made by scripts/readme.py -->\n", "<!-- end of {} -->\n"
SHOWN = (("shoulder", "max"), ("thigh", "max"), ("shank", "min"))
COLOURS = 128  # a palette keeps the picture small enough to live in the repository


def renew_tables() -> None:
    """Replaces the tables between their marks in README."""
    readme = ROOT / "README.md"
    text = readme.read_text(encoding="utf-8")
    result = protocol.run(seed=0)
    for name, grid in (("results", reproduce.table(result)), ("beyond", actuated_joint.table(result))):
        mark, end = MARK.format(name), END.format(name)
        pattern, new = re.escape(mark) + ".*?" + re.escape(end), mark + grid.markdown() + end
        text = re.sub(pattern, lambda _, new=new: new, text, flags=re.DOTALL)
    readme.write_text(text, encoding="utf-8")


def renew_picture() -> None:
    """Three stills side by side."""
    stills = {(joint, end): rgb for joint, end, rgb in leg_stills()}
    gap = np.full((480, 16, 3), 255, dtype=np.uint8)
    strip = Image.fromarray(np.hstack([stills[SHOWN[0]], gap, stills[SHOWN[1]], gap, stills[SHOWN[2]]]))
    small = strip.resize((strip.width // 2, strip.height // 2), Image.Resampling.LANCZOS)
    small.quantize(COLOURS, dither=Image.Dither.NONE).save(ROOT / "docs" / "leg.png", optimize=True)


if __name__ == "__main__":
    renew_tables()
    renew_picture()
