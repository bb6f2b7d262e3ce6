"""A folder of parts: a table that is written in pieces and can be continued after a kill."""

import hashlib
import io
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.base.errors import InputError
from sysid.base.files import ordinary, whole_file, write_text
from sysid.base.leftovers import in_use
from sysid.base.parquet import DamagedError
from sysid.base.parquet import read as read_parquet
from sysid.base.sealed import CHECK, check_sum

if TYPE_CHECKING:
    import polars

MANIFEST = "manifest.json"
KIND = "qpal ensemble"
NUMBER = "number"  # the column with the row's number


@dataclass(frozen=True)
class Parts:
    """Rows 0 to `rows` - 1 of a table in `folder`, `size` of them per Parquet file; `description` identifies the table.
    Each file is written under a temporary name, flushed to the disk and renamed: it is complete or does not exist.
    """

    folder: Path
    rows: int
    size: int
    description: Mapping[str, Any]
    versions: Mapping[str, str]

    @staticmethod
    def open(
        folder: Path, rows: int, size: int, description: Mapping[str, Any], versions: Mapping[str, str], new: bool
    ) -> "Parts":
        """The existing folder with its size of parts, or a new folder if `new` allows it.

        Raises InputError if the folder has other contents.
        """
        manifest = folder / MANIFEST
        if manifest.is_file():
            size = _same(manifest, description, versions, new)
            return Parts(folder, rows, size, description, versions)
        _check_empty(folder)
        if not new:
            raise InputError(f"{folder} has no ensemble yet; call run() first")
        Parts.place(folder)
        split = {"fingerprint": fingerprint(description), "rows": rows, "part": size}
        document = {
            "kind": KIND,
            **split,
            CHECK: check_sum(split, KIND),
            "versions": dict(versions),
            "description": dict(description),
        }
        write_text(manifest, json.dumps(document, indent=1) + "\n")
        return Parts(folder, rows, size, description, versions)

    @staticmethod
    def place(folder: Path) -> None:
        """Make the folder, if it is missing. Raises InputError if it has other contents or cannot be made."""
        if not (folder / MANIFEST).is_file():
            _check_empty(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder} cannot be created ({error.strerror}); choose another path") from None

    def __len__(self) -> int:
        return -(-self.rows // self.size)

    def numbers(self, k: int) -> range:
        """The rows of part k."""
        return range(k * self.size, min((k + 1) * self.size, self.rows))

    def path(self, k: int) -> Path:
        """Path of part k."""
        return self.folder / f"part-{k:05d}.parquet"

    def missing(self) -> list[int]:
        """The parts that are not yet written."""
        return [k for k in range(len(self)) if not self.path(k).is_file()]

    def sweep(self) -> None:
        """Remove temporary files of a killed writer."""
        for path in self.folder.glob(".part-*"):
            if not in_use(path.name):
                path.unlink(missing_ok=True)

    def write(self, k: int, table: "polars.DataFrame") -> None:
        """Write part k. Raises InputError, and leaves no partial file, if the disk is full or not writable."""
        path = self.path(k)
        content = io.BytesIO()
        table.write_parquet(content)
        try:
            with whole_file(path) as temporary:
                temporary.write_bytes(content.getbuffer())
        except OSError as error:
            if path.is_dir():
                raise InputError(f"{path} is a folder, where a part of the table belongs; remove it") from None
            raise InputError(
                f"{path} cannot be written ({error.strerror or error}); the {len(self) - len(self.missing())} parts "
                f"before it are kept: free disk space, or stop other writers, and run again"
            ) from None

    def read(
        self,
        columns: list[str] | None = None,
        seen: Sequence[str] = (),
        own: Callable[[dict[str, Any]], bool] = lambda row: True,
    ) -> Iterator["polars.DataFrame"]:
        """The parts that are written, in order, or some columns of them.

        Raises InputError for a damaged one, for one of other rows than its name says, and for one whose first or last
        row `own` denies, which gets the columns `seen` of it: a part of another ensemble.
        """
        looked = list(dict.fromkeys([NUMBER, *seen]))
        wanted = None if columns is None else list(dict.fromkeys([*looked, *columns]))

        for k in range(len(self)):
            path = self.path(k)
            if not path.is_file():
                continue
            try:
                found = read_parquet(path, wanted)
                if found[NUMBER].to_list() != list(self.numbers(k)):
                    raise OSError("it has other rows than its name says")
                if not all(own(found[looked].row(at, named=True)) for at in (0, -1)):
                    raise OSError("it has rows of another ensemble")
                yield found if columns is None else found.select(columns)
            except (OSError, DamagedError) as error:
                said = str(error).splitlines()[0]
                raise InputError(
                    f"{path} cannot be read ({said}); delete this file and run the ensemble again"
                ) from None


def _check_empty(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(not name.startswith(".") for name in os.listdir(folder))):
        raise InputError(f"{folder} exists and has no {MANIFEST}; choose an empty or a new folder")


def fingerprint(description: Mapping[str, Any]) -> str:
    """A hash (SHA-256) of a description as JSON."""
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()


def _same(manifest: Path, description: Mapping[str, Any], versions: Mapping[str, str], more: bool) -> int:
    """The size of the parts in the folder of `manifest`; raises InputError if it belongs to another ensemble.

    If `more` parts will be written, other software versions are refused too, because the parts would not match.
    """
    try:
        found = json.loads(ordinary(manifest).read_text(encoding="utf-8"))
        kind, size, theirs = found["kind"], int(found["part"]), found["description"]
        whole = kind == KIND and size > 0 and found["fingerprint"] == fingerprint(theirs)
        split = {name: found[name] for name in ("fingerprint", "rows", "part")}
        whole = whole and found.get(CHECK, check_sum(split, KIND)) == check_sum(split, KIND)  # older ones have none
        made = dict(found["versions"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        whole = False
    if not whole:
        raise InputError(f"{manifest} is damaged or not from an ensemble; choose another folder, or delete this one")
    if found["fingerprint"] != fingerprint(description):
        names = [name for name in {**theirs, **description} if theirs.get(name) != description.get(name)]
        raise InputError(
            f"{manifest.parent} has another ensemble, which differs in {', '.join(names)}; choose another folder"
        )
    other = [f"{name} {made.get(name)} and now {now}" for name, now in versions.items() if made.get(name) != now]
    if more and other:
        raise InputError(
            f"{manifest.parent} was started with {', '.join(other)}; use those versions, or choose another folder"
        )
    return size
