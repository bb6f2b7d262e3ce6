"""Parameter files of the twin, TOML and JSON."""

import json
from functools import cached_property
from pathlib import Path

import numpy as np

from fuzz.mutate import damaged, other_values
from fuzz.runner import WrongError
from twin.parameter_file import ROWS, check_together, read, to_toml, write
from twin.parameters import Parameters

SOME = {"pot_noise": 0.002, "thigh.coulomb": 40.0, "shank.coulomb": 35.5}


class ParameterFiles:
    """Values inside their bounds, which are written and read alike, or a sentence."""

    name = "parameters"
    seconds = 2.0

    @cached_property
    def _whole(self) -> list[tuple[str, bytes]]:
        """Files of few and of all parameters."""
        tables: dict = {}
        for name, row in ROWS.items():
            joint, _, key = name.rpartition(".")
            (tables.setdefault(joint, {}) if joint else tables)[key] = row.nominal
        some = Parameters({name: value for name, value in SOME.items() if name in ROWS})
        joints = {key: value for key, value in tables.items() if isinstance(value, dict)}
        full = "".join(f"{key} = {value!r}\n" for key, value in tables.items() if key not in joints)
        for joint, entries in joints.items():
            full += f"\n[{joint}]\n" + "".join(f"{name} = {value!r}\n" for name, value in entries.items())
        few = to_toml(some, ("a leg",), {})
        return [("a.toml", few.encode()), ("a.toml", full.encode()), ("a.json", json.dumps(tables).encode())]

    def ready(self) -> None:
        """The files."""
        assert self._whole

    def case(self, rng: np.random.Generator, folder: Path) -> str:
        """One file."""
        file, content = self._whole[int(rng.integers(3))]
        path = folder / file
        if file.endswith("json") and rng.random() < 0.6:
            content = json.dumps(other_values(rng, json.loads(content))).encode()
        else:
            content = damaged(rng, content)
        path.write_bytes(content)
        return check(path)


def check(path: Path) -> str:
    """How a parameter file ends."""
    found = read(path)
    for name, value in found.values.items():
        if not (np.isfinite(value) and ROWS[name].lower <= value <= ROWS[name].upper):
            raise WrongError(f"not finite: {name} is {value}")
    check_together(found, path)
    for suffix in (".toml", ".json"):
        if read(write(found, path.with_name(f"again{suffix}"), all=True)).values != found.values:
            raise WrongError("wrong number: written and read, it is another leg")
    return "read"
