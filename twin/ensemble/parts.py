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
from sysid.base.files import CHECK, atomic_file, check_regular_file, check_sum, write_text
from sysid.base.locks import is_in_use
from sysid.base.tables import DamagedError, read_parquet

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
            size = _manifest_size(manifest, description, versions, new)
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
            if not is_in_use(path.name):
                path.unlink(missing_ok=True)

    def write(self, k: int, table: "polars.DataFrame") -> None:
        """Write part k. Raises InputError, and leaves no partial file, if the disk is full or not writable."""
        path = self.path(k)
        content = io.BytesIO()
        table.write_parquet(content)
        try:
            with atomic_file(path) as temporary:
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
        own_columns: Sequence[str] = (),
        is_own_row: Callable[[dict[str, Any]], bool] = lambda row: True,
    ) -> Iterator["polars.DataFrame"]:
        """The parts that are written, in order, or some columns of them.

        Raises InputError for a damaged one, for one of other rows than its name says, and for one whose first or last
        row `is_own_row` denies, which gets the columns `own_columns` of it: a part of another ensemble.
        """
        checked_columns = list(dict.fromkeys([NUMBER, *own_columns]))
        read_columns = None if columns is None else list(dict.fromkeys([*checked_columns, *columns]))

        for k in range(len(self)):
            path = self.path(k)
            if not path.is_file():
                continue
            try:
                table = read_parquet(path, read_columns)
                if table[NUMBER].to_list() != list(self.numbers(k)):
                    raise OSError("it has other rows than its name says")
                if not all(is_own_row(table[checked_columns].row(place, named=True)) for place in (0, -1)):
                    raise OSError("it has rows of another ensemble")
                yield table if columns is None else table.select(columns)
            except (OSError, DamagedError) as error:
                reason = str(error).splitlines()[0]
                raise InputError(
                    f"{path} cannot be read ({reason}); delete this file and run the ensemble again"
                ) from None


def _check_empty(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(not name.startswith(".") for name in os.listdir(folder))):
        raise InputError(f"{folder} exists and has no {MANIFEST}; choose an empty or a new folder")


def fingerprint(description: Mapping[str, Any]) -> str:
    """A hash (SHA-256) of a description as JSON."""
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()


def _manifest_size(
    manifest: Path, description: Mapping[str, Any], versions: Mapping[str, str], is_writing: bool
) -> int:
    """The size of the parts in the folder of `manifest`; raises InputError if it belongs to another ensemble.

    If `is_writing` parts will be written, other software versions are refused too, because the parts would not match.
    """
    try:
        document = json.loads(check_regular_file(manifest).read_text(encoding="utf-8"))
        kind, size, kept_description = document["kind"], int(document["part"]), document["description"]
        is_valid = kind == KIND and size > 0 and document["fingerprint"] == fingerprint(kept_description)
        split = {name: document[name] for name in ("fingerprint", "rows", "part")}
        expected = check_sum(split, KIND)
        is_valid = is_valid and document.get(CHECK, expected) == expected  # older ones have none
        old_versions = dict(document["versions"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        is_valid = False
    if not is_valid:
        raise InputError(f"{manifest} is damaged or not from an ensemble; choose another folder, or delete this one")
    if document["fingerprint"] != fingerprint(description):
        names = [
            name for name in {**kept_description, **description} if kept_description.get(name) != description.get(name)
        ]
        raise InputError(
            f"{manifest.parent} has another ensemble, which differs in {', '.join(names)}; choose another folder"
        )
    changes = [
        f"{name} {old_versions.get(name)} and now {version}"
        for name, version in versions.items()
        if old_versions.get(name) != version
    ]
    if is_writing and changes:
        raise InputError(
            f"{manifest.parent} was started with {', '.join(changes)}; use those versions, or choose another folder"
        )
    return size
