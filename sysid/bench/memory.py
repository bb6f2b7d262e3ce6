"""Peak memory of this process since a moment, as Linux counts it."""

from pathlib import Path

_RESET, _STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")


def start_peak() -> None:
    """Count the peak from now on, where the system can."""
    try:
        _RESET.write_text("5")
    except OSError:
        return


def peak() -> float:
    """Peak resident memory [MiB] since `start_peak`; nan where the system does not tell."""
    try:
        rows = _STATUS.read_text().splitlines()
    except OSError:
        return float("nan")
    return next((int(row.split()[1]) / 1024 for row in rows if row.startswith("VmHWM")), float("nan"))
