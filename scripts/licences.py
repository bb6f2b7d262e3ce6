"""Licences of all that `pip install qpal` brings, as docs/licences.md: run it where the wheel alone is installed.

python scripts/licences.py > docs/licences.md
"""

import re
from importlib import metadata

from packaging.requirements import Requirement

HEAD = """# Licences

QPAL is under Apache-2.0. It needs {direct} packages, which need {others} more: {size:.0f} MB in all, of which
{own:.1f} MB are QPAL. Written by `python scripts/licences.py` from what the packages say of themselves.

| package | version | licence | MB | needed by |
| :-- | :-- | :-- | --: | :-- |"""
LONGEST = 60  # characters: some put the whole text where its name should be


def needs(name: str) -> list[str]:
    """Names of what a package needs on this machine, without extras."""
    found = [Requirement(text) for text in metadata.requires(name) or ()]
    return [canonical(r.name) for r in found if r.marker is None or r.marker.evaluate({"extra": ""})]


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def licence(name: str) -> str:
    """The licence's name: the SPDX expression, else the classifier, else the first line of the text."""
    info = metadata.metadata(name)
    classes = [c.rsplit(" :: ", 1)[1] for c in info.get_all("Classifier") or () if c.startswith("License :: ")]
    text = (info["License-Expression"] or ", ".join(classes) or info["License"] or "not stated").strip()
    return text.splitlines()[0][:LONGEST]


def size(name: str) -> float:
    """Installed size [MB]."""
    paths = (file.locate() for file in metadata.files(name) or () if not str(file).endswith(".pyc"))
    return sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


def main() -> None:
    """Print the page."""
    users: dict[str, set[str]] = {name: {"qpal"} for name in needs("qpal")}
    waiting = list(users)
    while waiting:
        name = waiting.pop()
        for other in needs(name):
            if other not in users:
                waiting.append(other)
            users.setdefault(other, set()).add(name)
    sizes, direct = {name: size(name) for name in users}, len(needs("qpal"))
    own = size("qpal")
    print(HEAD.format(direct=direct, others=len(users) - direct, size=sum(sizes.values()) + own, own=own))
    for name in sorted(users):
        by = ", ".join(sorted(users[name], key=lambda user: (user != "qpal", user)))
        print(f"| {name} | {metadata.version(name)} | {licence(name)} | {sizes[name]:.1f} | {by} |")


if __name__ == "__main__":
    main()
