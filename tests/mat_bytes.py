"""MAT files of level 5 byte by byte, after "MAT-File Format" (The MathWorks), for what no library writes."""

import struct

import numpy as np


def elements(tag: int, data: bytes) -> bytes:
    """A data element of a MAT file of level 5: tag, length, data padded to 8 bytes."""
    return struct.pack("<II", tag, len(data)) + data + b"\0" * (-len(data) % 8)


def level_5(*variables: bytes) -> bytes:
    head = b"MATLAB 5.0 MAT-file".ljust(116) + b"\0" * 8 + struct.pack("<HH", 0x0100, 0x4D49)
    return head + b"".join(variables)


def opaque(name: bytes) -> bytes:
    """A timeseries object as the file holds it: class 17, name, MCOS, class name, and a reference to MATLAB's store."""
    flags = elements(6, struct.pack("<II", 13, 0))
    reference = flags + elements(5, struct.pack("<ii", 6, 1)) + elements(1, b"")
    reference += elements(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
    content = elements(6, struct.pack("<II", 17, 0)) + elements(1, name) + elements(1, b"MCOS")
    return elements(14, content + elements(1, b"timeseries") + elements(14, reference))


def vector(name: bytes, values: np.ndarray, bits: int = 0, rows: int = 0) -> bytes:
    """A column of doubles; `bits` are its flags, `rows` the number of rows that it claims if not its own."""
    content = elements(6, struct.pack("<II", 6 | bits << 8, 0))
    content += elements(5, struct.pack("<ii", rows or len(values), 1))
    return elements(14, content + elements(1, name) + elements(9, values.astype("<f8").tobytes()))
