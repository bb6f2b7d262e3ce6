"""Logs: text tables whose meaning is known after a change, and files of every format with damaged bytes."""

import importlib
import json
from functools import cached_property
from pathlib import Path

import numpy as np

from fuzz.mutate import damaged, other_values
from fuzz.runner import WrongError
from fuzz.sheet import changed
from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.formats import read_table
from sysid.workflow.record import read_record

KNOWN = 0.4  # part of the cases whose right answer is known
NESTED = 0.1  # part of those with nested values changed


class Logs:
    """Whatever the bytes are: the right numbers, other finite ones where the damage may mean them, or a sentence."""

    name = "logs"
    seconds = 2.0

    @cached_property
    def _whole(self) -> list[tuple[str, bytes, dict]]:
        """Files of the corpus that are read right."""
        from corpus import LOGS, Right  # polars writes some of them, whose threads would not survive a fork

        return [
            (entry.file, entry.content, dict(entry.options))
            for entry in LOGS.values()
            if isinstance(entry.answer, Right) and not entry.answer.or_refused and not entry.fails
        ]

    def ready(self) -> None:
        """Modules alone: what polars has read before a fork would stop behind it."""
        for name in ("polars", "scipy.io", "scipy.signal", "h5py", "pint", "mcap.reader", "rosbags.rosbag1"):
            importlib.import_module(name)

    def case(self, rng: np.random.Generator, folder: Path) -> str:
        """One file."""
        how = rng.random()
        if how < KNOWN:
            return _known(rng, folder)
        json_alone = how < KNOWN + NESTED
        whole = [each for each in self._whole if Path(each[0]).suffix == ".json"] if json_alone else self._whole
        file, content, options = whole[int(rng.integers(len(whole)))]
        if json_alone:
            try:
                content = json.dumps(other_values(rng, json.loads(content))).encode()
            except ValueError:
                content = damaged(rng, content)
        else:
            content = damaged(rng, content)
        path = folder / Path(file).name
        path.write_bytes(content)
        return _read(path, options)


def _read(path: Path, options: dict) -> str:
    try:
        read_table(path)
    except InputError as error:
        if path.name not in str(error):
            raise WrongError(f"file not named: {error}") from None
        raise
    data = read_record(path, **options).data
    check(data)
    return "read"


def check(data: IOData) -> None:
    """Raises WrongError for a record that no fit can take."""
    for name, values in (("u", data.u), ("y", data.y)):
        if not np.isfinite(values).all():
            raise WrongError(f"not finite: {name}")
    if not 0 < data.Ts < np.inf:
        raise WrongError(f"not finite: Ts {data.Ts}")


def _known(rng: np.random.Generator, folder: Path) -> str:
    sheet = changed(rng)
    path = folder / "known.csv"
    path.write_bytes(sheet.content())
    try:
        data = read_record(path, missing=str(rng.choice(["refuse", "mark"]))).data
    except InputError as error:
        if sheet.sure:
            raise WrongError(f"false alarm: {error}") from None
        raise
    check(data)
    if abs(data.Ts - sheet.Ts) > 1e-5 * sheet.Ts:
        raise WrongError(f"wrong number: Ts is {data.Ts}, not {sheet.Ts}")
    kept = np.array([k not in sheet.loose for k in range(len(sheet.signals[1]))])
    for name, found, right in (("u", data.u, sheet.signals[1]), ("y", data.y, sheet.signals[2])):
        if found.shape != (len(right), 1):
            raise WrongError(f"wrong number: {len(found)} samples, not {len(right)}")
        if not np.allclose(found[kept, 0], right[kept], rtol=1e-9, atol=1e-12):
            k = int(np.argmax(np.abs(found[:, 0] - right) * kept))
            raise WrongError(f"wrong number: {name} is {found[k, 0]} in sample {k}, not {right[k]}")
    return "same"
