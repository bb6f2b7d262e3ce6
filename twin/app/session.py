"""A session: a folder of records, models and studies. What is damaged becomes a sentence, and the rest opens.

    session.json        settings (`entries.Head`)
    data/d1/            entry.json (`entries.Data`), the log as it came, record.npz as it was read
    models/m1/          entry.json (`entries.Model`), model.json, runs.npz, figures.json, report.html, ...
    studies/s1/         entry.json (`entries.Study`), report.html, figures.json, ...

Names of files and folders are made here: no text from a browser becomes a path.
"""

import json
import os
import re
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from sysid.base.errors import InputError
from sysid.base.files import read_limited, write_text
from sysid.base.locks import Lock, take_lock
from twin.app.entries import DATA_ID, LARGEST, MODEL_ID, SMALL, STUDY_ID, Data, Entry, Head, Model, Study, complaint

HEAD, ENTRY, LOCK = "session.json", "entry.json", ".lock"
NEW, GONE = ".new-", ".gone-"  # folders that are being written, and those that were deleted but can be restored
E = TypeVar("E", bound=Entry)
KINDS: dict[str, tuple[str, str, type[Entry]]] = {
    "data": ("d", DATA_ID, Data),
    "models": ("m", MODEL_ID, Model),
    "studies": ("s", STUDY_ID, Study),
}


class Session:
    """An open session; `complaints` says what could not be opened, and `version` rises with every change."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.head = Head()
        self.data: dict[str, Data] = {}
        self.models: dict[str, Model] = {}
        self.studies: dict[str, Study] = {}
        self.complaints: list[str] = []
        self.version = 0
        self._gone: dict[tuple[str, str], Entry] = {}
        self._lock: Lock | None = None
        self._thread_lock = threading.RLock()  # jobs and pages change it from their own threads

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> "Session":
        """The session in `folder`, which is made if it is missing.

        Raises InputError for a folder of other files, one that cannot be written to, one that another app has open,
        and a session of a newer version.
        """
        session = cls(Path(os.path.realpath(folder)))  # `Path.resolve` raises for a link to itself
        try:
            session._prepare(folder)
            session._read()
        except OSError as error:
            session.close()
            raise InputError(f"{folder} cannot be a session: {error.strerror or error}; give another folder") from None
        except InputError:
            session.close()
            raise
        return session

    def _prepare(self, name: str | os.PathLike[str]) -> None:
        """Lock the folder, and make what it lacks."""
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(f"{name} is a file; give a folder for --session")
        if self.folder.is_dir() and any(self.folder.iterdir()) and not _is_session(self.folder):
            raise InputError(f"{name} holds other files and no session; give a new folder for --session")
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = take_lock(self.folder / LOCK, self._locked_message)
        for kind in KINDS:
            self._own(Path(kind)).mkdir(exist_ok=True)
        self._clear()  # what a kill left

    def _clear(self) -> None:
        """Delete what was not written whole, and for good what was deleted."""
        for folder in (self.folder / kind for kind in KINDS):
            if os.path.realpath(folder) == str(folder):  # a link may lead anywhere
                for remnant in (*folder.glob(f"{NEW}*"), *folder.glob(f"{GONE}*")):
                    shutil.rmtree(remnant, ignore_errors=True)

    def close(self) -> None:
        """Another app may open the folder."""
        if self._lock is not None:
            self._clear()
            self._lock.close(remove=False)
            self._lock = None

    def _locked_message(self, owner: str) -> str:
        return (
            f"{self.folder} is open in another qpal app ({owner}); close that one, or give another folder for --session"
        )

    def change(self, **fields: Any) -> None:
        """Change fields of `head` and write it."""
        with self._thread_lock:
            self.head = Head.model_validate({**self.head.model_dump(), **fields})
            write_text(self.folder / HEAD, self.head.model_dump_json(indent=2) + "\n")
            self.version += 1

    def add(self, entry: Entry, fill: Callable[[Path], None]) -> str:
        """A new entry's id; `fill` writes its files into a folder that appears only when it is whole."""
        kind = next(name for name, (_, _, cls) in KINDS.items() if isinstance(entry, cls))
        with self._thread_lock, self._new(kind) as folder:
            fill(folder)
            write_text(folder / ENTRY, entry.model_dump_json(indent=2) + "\n")
            key = self._free_id(kind)
            os.rename(folder, self.folder / kind / key)
            getattr(self, kind)[key] = entry
            self.version += 1
        return key

    def change_data(self, key: str, **fields: Any) -> Data:
        """Change fields of a record's entry and write it; raises InputError for fields out of their limits."""
        with self._thread_lock:
            if key not in self.data:
                raise InputError(f"this session has no record {key!r} any more")
            entry = Data.from_form({**self.data[key].model_dump(), **fields})
            write_text(self.folder / "data" / key / ENTRY, entry.model_dump_json(indent=2) + "\n")
            self.data[key] = entry
            self.version += 1
        return entry

    def add_file(self, kind: str, key: str, file: Path) -> None:
        """Move a file into the folder of an entry, where it appears whole; nothing if the entry is gone."""
        with self._thread_lock:
            if key not in getattr(self, kind):
                return
            shutil.move(file, self.folder / kind / key / f"{NEW}{file.name}")  # it may come from another disk
            os.replace(self.folder / kind / key / f"{NEW}{file.name}", self.folder / kind / key / file.name)
            self.version += 1

    def remove(self, kind: str, key: str) -> None:
        """Delete an entry and its files, which can be restored until the session is closed."""
        with self._thread_lock:
            if (entry := getattr(self, kind).pop(key, None)) is None:
                return
            os.rename(self.folder / kind / key, self.folder / kind / f"{GONE}{key}")
            self._gone[kind, key] = entry
            self.version += 1

    def restore(self, kind: str, key: str) -> None:
        """Take a deleted entry back; raises InputError for one that was not deleted since the session is open."""
        with self._thread_lock:
            if (kind, key) not in self._gone:
                raise InputError(f"{key} was not deleted since this session is open")
            os.rename(self.folder / kind / f"{GONE}{key}", self.folder / kind / key)
            entries = {**getattr(self, kind), key: self._gone.pop((kind, key))}
            setattr(self, kind, dict(sorted(entries.items(), key=lambda item: int(item[0][1:]))))
            self.version += 1

    def file(self, kind: str, key: str, name: str) -> Path:
        """A file of an entry; raises InputError for an entry that is not there."""
        if key not in getattr(self, kind):
            raise InputError(f"this session has no {key[:20]!r}; it has {', '.join(getattr(self, kind)) or 'none yet'}")
        return self._own(Path(kind, key, name))

    def has(self, kind: str, key: str, name: str) -> bool:
        """Whether an entry has a file of this name, of its own and not a link."""
        path = self.folder / kind / key / name
        return path.is_file() and os.path.realpath(path) == str(path)

    def _own(self, place: Path) -> Path:
        """A path in the folder; raises InputError for a link, which may lead anywhere, also on its way."""
        path = self.folder / place
        if os.path.realpath(path) != str(path):
            raise InputError(f"{place.as_posix()} is a link; put the file itself in its place")
        return path

    def log(self, key: str) -> Path:
        """The log of a record."""
        return self.file("data", key, self.data[key].file if key in self.data else "")

    @contextmanager
    def _new(self, kind: str) -> Iterator[Path]:
        folder = Path(tempfile.mkdtemp(prefix=NEW, dir=self.folder / kind))
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _free_id(self, kind: str) -> str:
        letter = KINDS[kind][0]
        folders = (self.folder / kind).iterdir()
        names = [path.name.removeprefix(GONE)[1:] for path in folders if path.name.removeprefix(GONE)[:1] == letter]
        numbers = [int(name) for name in names if name.isdigit()]
        return f"{letter}{max(numbers, default=0) + 1}"

    def _read(self) -> None:
        """Read settings and entries; what is damaged becomes a complaint."""
        path = self.folder / HEAD
        if os.path.lexists(path):
            try:
                self.head = _entry(self._own(Path(HEAD)), Head)
            except InputError as error:
                _refuse_newer(path)
                os.replace(path, self.folder / "session.damaged.json")
                self.complaints.append(
                    f"{error}; the settings start afresh, and the file is kept as session.damaged.json"
                )
        else:
            self.change()
        for kind, (_, pattern, cls) in KINDS.items():
            keys = [path.name for path in (self.folder / kind).iterdir() if re.fullmatch(pattern, path.name)]
            for key in sorted(keys, key=lambda key: int(key[1:])):
                try:
                    entry = _entry(self._own(Path(kind, key, ENTRY)), cls)
                    if isinstance(entry, Data):
                        _check_log(self._own(Path(kind, key, entry.file)), f"{kind}/{key}/{entry.file}")
                except InputError as error:
                    self.complaints.append(f"{error}; {key} is left out, and its files are as they were")
                    continue
                getattr(self, kind)[key] = entry


def _entry(path: Path, cls: type[E]) -> E:
    name = "/".join(path.parts[-3:]) if path.name == ENTRY else path.name
    try:
        return cls.model_validate_json(read_limited(path, SMALL))
    except OSError as error:
        raise InputError(f"{name} cannot be read: {error.strerror}") from None
    except ValidationError as error:
        raise InputError(f"{name} is damaged: {complaint(error)}") from None


def _check_log(path: Path, name: str) -> None:
    """Raises InputError for a log that is missing, no file, or larger than the app takes in."""
    if not path.is_file():
        raise InputError(f"{name} is missing")
    if path.stat().st_size > LARGEST:
        raise InputError(f"{name} is larger than {LARGEST // 2**20} MiB; give a shorter part of it")


def _refuse_newer(path: Path) -> None:
    try:
        version = json.loads(read_limited(path, SMALL)).get("version")
    except (OSError, InputError, ValueError, AttributeError, RecursionError):
        return
    if isinstance(version, int) and version > Head().version:
        raise InputError(f"{path} has version {version}; this qpal reads up to {Head().version}: install a newer one")


def _is_session(folder: Path) -> bool:
    return (folder / HEAD).is_file() or (folder / LOCK).is_file() or (folder / "session.damaged.json").is_file()
