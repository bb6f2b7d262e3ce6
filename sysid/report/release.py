"""docs/certificate.md: the certificate of a release in Markdown, made from its numbers alone."""

from collections.abc import Mapping, Sequence
from typing import Any

from sysid.bench.certificate.grade import Grade
from sysid.bench.certificate.release import ENOUGH, departures, fewest
from sysid.bench.certificate.static import StaticGrade
from sysid.report import certificate as digits
from sysid.report.page import Grid

LEVELS = (50, 90, 95, 99)  # [%] of the intervals in the counts


def page(numbers: Mapping[str, Any]) -> str:
    """The page of `sysid.bench.certificate.release.certificate`."""
    rows = [Grade(**row) for row in numbers["dynamic"]]
    sets = [StaticGrade(**row) for row in numbers["static"]]
    parts = [
        f"# Certificate of QPAL {numbers['versions']['qpal']}",
        f"{numbers['date']}, written by `qpal bench certify --page`. What is certified, and how: "
        "[certified values](certify.md), [intervals](intervals.md#whether-the-whole-distribution-is-right).",
        "\n".join(f"- {sentence}" for sentence in verdicts(numbers)),
        "## Digits",
        digits.static_grid(sets).markdown(),
        digits.dynamic_grid(rows).markdown(),
        "## Distribution of intervals",
        intervals_grid(numbers["intervals"]).markdown(),
        "## Machine, data and code",
        _machine(numbers).markdown(),
        "## Every set and record",
        digits.every_set(sets).markdown(),
        digits.every(rows).markdown(),
    ]
    return "\n\n".join(part.removesuffix("\n") for part in parts) + "\n"


def verdicts(numbers: Mapping[str, Any]) -> list[str]:
    """A sentence for each rule, whether it holds, and what breaks it."""
    outside, total, by_chance = departures(numbers["intervals"])
    held, least = "It holds", fewest(numbers["intervals"])
    if outside > by_chance:
        held = "It DOES NOT HOLD"
    elif least < ENOUGH:
        held = f"It is NOT YET JUDGED, which takes {ENOUGH} cases of each, and the fewest are {least}"
    return [
        digits.rules(True, numbers["violations"]),
        *numbers["violations"],
        f"Rule: of the distributions of true values under their intervals no more leave their 95 % band than chance "
        f"makes in 99 of 100 certificates, {by_chance} of {total}. {held}: {outside} do.",
    ]


def intervals_grid(rows: Sequence[Mapping[str, Any]]) -> Grid:
    """A row for each structure, noise and value: how far its distribution departs, and what intervals hold."""
    cells = []
    for row in rows:
        shown = [digits.NONE] * (2 + len(LEVELS))
        if "held" in row:
            held = [f"{100 * share:.0f}" for share in row["held"]]
            shown = [f"{row['departure']:.3f}", "yes" if row["inside"] else "NO", *held]
        kind = row["kind"].replace("_", " ")
        cells.append([f"`{row['structure']}`", row["noise"], kind, str(row["n"]), str(row["open"]), *shown])
    headings = ["structure", "noise", "value", "n", "no interval", "largest departure", "in its band"]
    return Grid([*headings, *(f"{level} % holds" for level in LEVELS)], cells, text_columns=3)


def _machine(numbers: Mapping[str, Any]) -> Grid:
    hashes = {f"sha256 of {name}": f"`{value}`" for name, value in numbers["sha256"].items()}
    rows = [*numbers["machine"].items(), *numbers["versions"].items(), *hashes.items()]
    return Grid(["", "value"], [list(row) for row in rows], text_columns=2)
