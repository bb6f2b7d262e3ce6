"""Text files written whole or not at all."""

import os
import tempfile
from pathlib import Path

from sysid.base.errors import InputError


def write_text(path: str | os.PathLike, text: str) -> Path:
    """Write `text` to a temporary name beside `path`, then rename it: a reader never sees half a file.

    Raises InputError where the folder is missing or may not be written to.
    """
    target = Path(path)
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    except OSError as e:
        raise InputError(f"cannot write {target}: {e.strerror}; choose a folder that exists and is yours") from None
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp gives 0600; a file that open() makes would follow the user's umask.
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, target)
    except OSError as e:
        Path(temporary).unlink(missing_ok=True)
        raise InputError(f"cannot write {target}: {e.strerror}; choose another name") from None
    return target
