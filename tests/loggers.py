"""Files of measurement programs and robots, written by their published layouts or by their libraries."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

Series = tuple[np.ndarray, np.ndarray]  # times (n,) [s] and values (n,)


def mdf(path: Path, u: Series, y: Series) -> None:
    pytest.importorskip("asammdf", reason="asammdf is in the mdf extra")
    from asammdf import MDF, Signal

    with MDF(version="4.10" if path.suffix == ".mf4" else "3.30") as file:
        signals = [Signal(x, t, name=n, unit=unit) for n, unit, (t, x) in (("u", "V", u), ("angle", "rad", y))]
        if len(u[0]) == len(y[0]):
            file.append(signals, common_timebase=True)
        else:
            for signal in signals:
                file.append([signal], acq_name=signal.name)
        file.save(path, overwrite=True)


def tdms(path: Path, u: Series, y: Series) -> None:
    pytest.importorskip("nptdms", reason="npTDMS is in the tdms extra")
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as file:
        for group, name, unit, (t, x) in (("cmd", "u", "V", u), ("joint", "angle", "rad", y)):
            wave = {"wf_increment": t[1] - t[0], "wf_start_offset": t[0], "unit_string": unit}
            file.write_segment([ChannelObject(group, name, x, properties=wave)])


def ulog(path: Path, u: Series, y: Series) -> None:
    """By the layout of PX4's ULog file format: file header, flag bits, formats, subscriptions, data."""

    pytest.importorskip("pyulog", reason="pyulog is in the ulog extra")

    def message(kind: str, content: bytes) -> bytes:
        return struct.pack("<HB", len(content), ord(kind)) + content

    start = 5_000_000
    raw = b"\x55\x4c\x6f\x67\x01\x12\x35\x01" + struct.pack("<Q", start) + message("B", bytes(40))
    for name, fields in (("cmd", "uint64_t timestamp;double u;"), ("joint", "uint64_t timestamp;double angle;")):
        raw += message("F", f"{name}:{fields}".encode())
    raw += b"".join(message("A", struct.pack("<BH", 0, k) + name) for k, name in enumerate((b"cmd", b"joint")))
    samples = [(t, k, x) for k, series in enumerate((u, y)) for t, x in zip(*series, strict=True)]
    for t, k, x in sorted(samples):
        raw += message("D", struct.pack("<HQd", k, start + round(t * 1e6), x))
    path.write_bytes(raw)


def wpilog_record(number: int, stamp: float, payload: bytes) -> bytes:
    """Entry, size and stamp in as few bytes as they need."""
    values = (number, len(payload), round(stamp * 1e6))
    lengths = [max(1, (value.bit_length() + 7) // 8) for value in values]
    bits = lengths[0] - 1 | lengths[1] - 1 << 2 | lengths[2] - 1 << 4
    numbers = (value.to_bytes(length, "little") for value, length in zip(values, lengths, strict=True))
    return bytes([bits]) + b"".join(numbers) + payload


def wpilog_start(number: int, name: str, kind: str) -> bytes:
    texts = b"".join(struct.pack("<I", len(text)) + text.encode() for text in (name, kind, ""))
    return wpilog_record(0, 0.0, struct.pack("<BI", 0, number) + texts)


def wpilog(path: Path, u: Series, y: Series) -> None:
    raw = b"WPILOG" + struct.pack("<HI", 0x0100, 5) + b"extra"
    raw += wpilog_start(1, "motor/voltage", "double") + wpilog_start(300, "arm/angle", "double")
    raw += wpilog_start(2, "state", "string") + wpilog_record(2, 0.0, b"auto")
    samples = [(t, k, x) for k, series in ((1, u), (300, y)) for t, x in zip(*series, strict=True)]
    raw += b"".join(wpilog_record(k, t, struct.pack("<d", x)) for t, k, x in sorted(samples))
    path.write_bytes(raw)


def lvm(path: Path, u: Series, y: Series) -> None:
    """X columns: one where both have one clock, one for each channel elsewhere."""
    one = len(u[0]) == len(y[0])
    lines = ["LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab", "Decimal_Separator\t."]
    lines += ["Multi_Headings\tYes", f"X_Columns\t{'One' if one else 'Multi'}", "Time_Pref\tRelative"]
    lines += ["Date\t2024/05/16", "Time\t12:00:30.5", "***End_of_Header***\t", ""]
    counts = f"{len(u[0])}\t{len(y[0])}"
    lines += ["Channels\t2\t", f"Samples\t{counts}\t", "Date\t2024/05/16\t2024/05/16", "Time\t12:00:30.5\t12:00:30.5"]
    lines += [
        "Y_Unit_Label\tVolts\tradians",
        "X_Dimension\tTime\tTime",
        "X0\t0\t0",
        f"Delta_X\t{np.diff(u[0])[0]}\t{np.diff(y[0])[0]}",
    ]
    names = "X_Value\tVoltage\tAngle\tComment" if one else "X_Value\tVoltage\tX_Value\tAngle\tComment"
    lines += ["***End_of_Header***\t\t", names]
    for k in range(max(len(u[0]), len(y[0]))):
        pairs = [[f"{t[k]:.6f}", repr(float(x[k]))] if k < len(t) else ["", ""] for t, x in (u, y)]
        lines.append("\t".join([*pairs[0], *(pairs[1][1:] if one else pairs[1])]))
    path.write_text("\n".join(lines) + "\n")


def advantage_scope(path: Path, u: Series, y: Series) -> None:
    """A row for each stamp; cells are empty where a field has no value at it."""
    cells: dict[float, list[str]] = {}
    for k, (t, x) in enumerate((u, y)):
        for stamp, value in zip(np.round(t, 6).tolist(), x.tolist(), strict=True):
            cells.setdefault(stamp, ["", ""])[k] = repr(value)
    rows = (",".join([f"{stamp}", *cells[stamp]]) for stamp in sorted(cells))
    path.write_text("Timestamp,/Motor/Voltage,/Arm/Angle\n" + "\n".join(rows) + "\n")


WRITERS: dict[str, Callable[[Path, Series, Series], None]] = {
    "a.mf4": mdf,
    "a.mdf": mdf,
    "a.tdms": tdms,
    "a.ulg": ulog,
    "a.wpilog": wpilog,
    "a.lvm": lvm,
    "a.csv": advantage_scope,
}
