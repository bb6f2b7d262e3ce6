"""Writes sysid/bench/certificate/nist from the files of NIST's StRD, nonlinear regression: python nist_sets.py FOLDER.

FOLDER holds the published .dat files (itl.nist.gov/div898/strd), which are works of the US government. The numbers are
kept as they are printed there; the functions are in `sysid.bench.certificate.functions`.
"""

import json
import re
import sys
from pathlib import Path

OUT = Path(__file__).resolve().parents[2] / "sysid" / "bench" / "certificate" / "nist"
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[Ee][-+]?\d+)?"


def converted(text: str) -> tuple[dict, str]:
    """What is certified of one file, and its data as CSV with y first."""
    lines = text.replace("\r", "").split("\n")
    level = re.search(r"(Lower|Average|Higher) Level of Difficulty", text)
    rows = [re.findall(NUMBER, line.split("=", 1)[1]) for line in lines if re.match(r"\s*b\d\s*=\s", line)]
    rows = [row for row in rows if len(row) == 4]  # the models' own equations are no rows of the table
    parts = {}
    for key, label in (("rss", "Residual Sum of Squares"), ("count", "Number of Observations")):
        parts[key] = re.search(rf"{label}:\s*({NUMBER})", text)[1]
    begin, end = map(int, re.search(r"^\s*Data\s*\(lines (\d+) to (\d+)\)", text, flags=re.M).groups())
    data = [line.split() for line in lines[begin - 1 : end] if line.strip()]
    assert level
    assert len(data) == int(parts["count"]), (len(data), parts["count"])
    names = ["y", *(["x"] if len(data[0]) == 2 else [f"x{k}" for k in range(1, len(data[0]))])]
    facts = {
        "level": level[1].lower(),
        "start1": [row[0] for row in rows],
        "start2": [row[1] for row in rows],
        "parameters": [row[2] for row in rows],
        "deviations": [row[3] for row in rows],
        "rss": parts["rss"],
    }
    return facts, "\n".join(",".join(row) for row in [names, *data]) + "\n"


def main(folder: str) -> None:
    """Convert all files of a folder."""
    sets = {}
    OUT.mkdir(parents=True, exist_ok=True)
    for path in sorted(Path(folder).glob("*.dat")):
        sets[path.stem], table = converted(path.read_text(encoding="ascii"))
        (OUT / f"{path.stem}.csv").write_text(table, encoding="ascii")
    (OUT / "certified.json").write_text(json.dumps(sets, indent=1) + "\n", encoding="ascii")


if __name__ == "__main__":
    main(sys.argv[1])
