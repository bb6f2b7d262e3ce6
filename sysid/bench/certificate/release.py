"""What a certificate of a release states beside digits: its version and date, the machine, hashes, and intervals."""

import hashlib
import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from scipy.stats import binom
from threadpoolctl import threadpool_info

from sysid.base.files import versions
from sysid.bench.certificate import record, static
from sysid.bench.certificate.grade import Grade
from sysid.bench.certificate.static import StaticGrade

SBC = Path(__file__).with_name("sbc.json")  # made by `scripts/study.py sbc --counts`
PAGE = "certificate.md"
_PACKAGE = Path(__file__).parents[2]
_CHANCE = 0.01  # that so many distributions, each in a band of 95 %, leave it where all are right
_OUTSIDE = 0.05
ENOUGH = 500  # cases of a row: a distribution that departs by 0.06 then leaves its band


def certificate(rows: Sequence[Grade], sets: Sequence[StaticGrade], violations: Sequence[str]) -> dict[str, Any]:
    """All that the page of a release says, as JSON values: its text is a function of them alone."""
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "versions": versions(),
        "machine": machine(),
        "sha256": {
            "NIST's sets": digest(static.FOLDER.iterdir()),
            "dynamic records": digest(record.FOLDER.iterdir()),
            "counts of intervals": digest([SBC]),
            "code of sysid": digest(file for file in _PACKAGE.rglob("*.py") if file.parent.name != "peers"),
        },
        "violations": list(violations),
        "dynamic": [asdict(row) for row in rows],
        "static": [asdict(row) for row in sets],
        "intervals": json.loads(SBC.read_text(encoding="ascii")),
    }


def digest(files: Iterable[Path]) -> str:
    """sha256 over names and contents of files, in the order of their names."""
    total = hashlib.sha256()
    for file in sorted(files):
        total.update(f"{file.relative_to(_PACKAGE).as_posix()}\n".encode())
        total.update(hashlib.sha256(file.read_bytes()).digest())
    return total.hexdigest()


def machine() -> dict[str, str]:
    """The kind of processor, its cores, the system, and the libraries of linear algebra; nothing names the host."""
    kind = platform.processor() or platform.machine()
    with suppress(OSError, StopIteration):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        kind = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    parts = ("internal_api", "version", "architecture")
    blas = [
        " ".join(str(each.get(part, "")) for part in parts).strip()
        for each in threadpool_info()
        if each["user_api"] == "blas"
    ]
    return {
        "processor": kind,
        "cores": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
        "BLAS": ", ".join(dict.fromkeys(blas)),
    }


def departures(intervals: Sequence[Mapping[str, Any]]) -> tuple[int, int, int]:
    """How many distributions of true values leave their band, of how many, and how many may by chance."""
    inside = [row["inside"] for row in intervals if "inside" in row]
    return inside.count(False), len(inside), int(binom.isf(_CHANCE, len(inside), _OUTSIDE))


def fewest(intervals: Sequence[Mapping[str, Any]]) -> int:
    """The fewest cases, with and without an interval, of a row."""
    return min(row["n"] + row["open"] for row in intervals)


def page_file() -> Path | None:
    """The last full certificate: that of the installed package, else that of the clone; None without both."""
    places = (Path(__file__).with_name(PAGE), _PACKAGE.parent / "docs" / PAGE)
    return next((place for place in places if place.is_file()), None)
