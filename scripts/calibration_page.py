"""The story of docs/calibrate.md: a stand-in's captures, `qpal calibrate`, and the pictures of its report.

python scripts/calibration_page.py
"""

import json
import os
import sys
import tempfile
from pathlib import Path

from twin.cli import main

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import standin  # noqa: E402

JOINT, SEED = "thigh", 7
SHOWN = {"overlay-3": "held-out", "residuals": "residuals", "correlation": "correlation"}


def story(docs: Path) -> None:
    """Write the pictures into `docs` and print what the console shows and the parameter file."""
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        captures, fresh, mapping = standin.written(standin.StandIn(JOINT, SEED), Path())
        command = ["calibrate", *map(str, captures), "--joint", JOINT, "--map", str(mapping), "--hold-out", str(fresh)]
        print("$ qpal", *command, "--out run")
        print("exit code", main([*command, "--out", "run"]))
        print(Path(f"run/{JOINT}.toml").read_text(encoding="utf-8"))
        true = standin.hidden(JOINT, SEED)
        for value in json.loads(Path("run/summary.json").read_text(encoding="utf-8"))["parameters"]:
            print(value["name"], "true", true[value["name"]], "found", value["low"], value["value"], value["high"])
        for figure, name in SHOWN.items():
            (docs / f"calibrate-{name}.png").write_bytes(Path(f"run/figures/{figure}.png").read_bytes())


if __name__ == "__main__":
    story(ROOT / "docs")
