"""Time stamps: units, dates, counters, repeated and lost ones, and ones that contradict each other."""

from corpus._log import PAIRS, ROWS, SAFE, TS, Log, Right, U, Y, log, refused, stamped, with_row

HEAD = "time,u,y\n"
TENTHS = [f"{k / 10:.1f}" for k in range(12)]
LOST = Right(  # the sample at 0.5 s: the input is held, the output follows a straight line
    u=(0.5, 0.5, -1.0, -1.0, 2.0, 2.0, 1.5, 1.5, -2.0, -2.0, 0.0, 1.0),
    y=(1.25, 0.75, -0.5, -1.5, 0.25, 1.875, 3.5, 3.0, 1.0, -1.0, -2.25, -1.75),
)
STEPS_OF_7MS = Right(Ts=0.007)


def counted(first: float, step: float, digits: int = 0) -> str:
    """Rows whose stamps count from `first` in steps of `step`."""
    return stamped([f"{first + step * k:.{digits}f}" for k in range(12)])


LOGS: dict[str, Log] = {
    # dates and times of day become seconds where they have one reading
    "ISO dates": log(HEAD + stamped([f"2024-05-06T12:00:0{t}" for t in TENTHS])),
    "ISO dates with a blank": log(HEAD + stamped([f"2024-05-06 12:00:0{t}" for t in TENTHS])),
    "ISO dates in UTC": log(HEAD + stamped([f"2024-05-06T12:00:0{t}00Z" for t in TENTHS])),
    "ISO dates with a zone": log(HEAD + stamped([f"2024-05-06T12:00:0{t}00+02:00" for t in TENTHS])),
    "ISO dates whose zone changes": log(
        HEAD
        + stamped(
            [f"2026-03-29T01:59:59.{k}+01:00" for k in range(4, 10)]
            + [f"2026-03-29T03:00:00.{k}+02:00" for k in range(6)]
        )
    ),
    "ISO dates of which some have a zone": log(
        HEAD + stamped([f"2024-05-06T12:00:0{t}{'Z' if t > '0.4' else ''}" for t in TENTHS]),
        refused("row 7", "offset from UTC", "--ts"),
    ),
    "ISO dates over the change of clocks": log(
        HEAD
        + stamped([f"2026-03-29T01:59:59.{k}" for k in range(4, 10)] + [f"2026-03-29T03:00:00.{k}" for k in range(6)]),
        refused("row 8", "3600 s", "change of clocks", "--range"),
    ),
    "ISO dates over the change of clocks back": log(
        HEAD
        + stamped([f"2026-10-25T02:59:59.{k}" for k in range(4, 10)] + [f"2026-10-25T02:00:00.{k}" for k in range(6)]),
        refused("row 8", "time must increase", "change of clocks"),
    ),
    "ISO dates, one garbled": log(
        HEAD + stamped([f"2024-05-06T12:00:0{t}".replace("00:00.5", "00:xx.5") for t in TENTHS]),
        refused("row 7", "12:00:xx.5", "correct the cell"),
    ),
    "ISO dates, one not in the calendar": log(
        HEAD + stamped([f"2023-02-{'29' if t == '0.5' else '28'}T12:00:0{t}" for t in TENTHS]),
        refused("row 7", "2023-02-29", "correct the cell"),
    ),
    "dates with the day first": log(HEAD + stamped([f"06.05.2024 12:00:0{t}" for t in TENTHS])),
    "dates with the day first and a decimal comma": log(
        "Datum;u;y\n"
        + stamped(
            [
                f"23.11.2026 23:59:{59 + k / 10:.1f}" if k < 10 else f"24.11.2026 00:00:0{k / 10 - 1:.1f}"
                for k in range(12)
            ],
            ";",
        )
        .replace(".", ",")
        .replace(",11,2026", ".11.2026")
    ),
    "dates with the month first": log(HEAD + stamped([f"5/6/2024 12:00:0{t}" for t in TENTHS])),
    "dates with two readings that differ": log(
        HEAD + stamped([f"5/6/2024 23:59:59.{k}" for k in range(10)] + ["5/7/2024 00:00:00.0", "5/7/2024 00:00:00.1"]),
        refused("day/month/year or month/day/year", "write the year first"),
    ),
    "dates with one reading over midnight": log(
        HEAD
        + stamped([f"5/13/2024 23:59:59.{k}" for k in range(10)] + ["5/14/2024 00:00:00.0", "5/14/2024 00:00:00.1"])
    ),
    "dates with AM and PM": log(
        HEAD
        + stamped([f"5/6/2024 11:59:{50 + k} AM" if k < 10 else f"5/6/2024 12:00:{k - 10:02d} PM" for k in range(12)]),
        Right(Ts=1.0),
    ),
    "dates that are coarser than the samples": log(
        HEAD + stamped([f"2024-05-06 12:00:0{t[0]}" for t in TENTHS]), refused("--ts")
    ),
    "dates in words": log(
        HEAD + stamped([f"Mon 6 May 12:00:0{t}" for t in TENTHS]), refused("holds dates or times", "'Mon 6 May", "--ts")
    ),
    "dates and their unit in the mapping": log(
        HEAD + stamped([f"2024-05-06T12:00:0{t}" for t in TENTHS]),
        refused("holds dates", "leave unit"),
        time="time",
        time_unit="ms",
    ),
    "times of day": log(HEAD + stamped([f"12:00:0{t}" for t in TENTHS])),
    "times of day over midnight": log(
        HEAD + stamped([f"23:59:{59 + k / 10:04.1f}" if k < 10 else f"00:00:0{(k - 10) / 10}" for k in range(12)])
    ),
    "times of day that start again": log(HEAD + stamped([f"12:00:0{t}" for t in [*TENTHS[:6], *TENTHS[:6]]])),
    "times of day that run back": log(
        HEAD + stamped([f"12:00:0{t}" for t in [*TENTHS[:8], *TENTHS[3:7]]]), refused("row 10", "time must increase")
    ),
    "spans longer than a day": log(HEAD + stamped([f"{24 - (t < '0.5')}:59:0{t}" for t in TENTHS]), refused("3600 s")),
    "times of day with milliseconds behind a colon": log(
        HEAD + stamped([f"12:00:{k // 10:02d}:{100 * (k % 10):03d}" for k in range(12)])
    ),
    "minutes and seconds": log(
        HEAD + stamped([f"00:0{t}" for t in TENTHS]), refused("column 'time' holds dates or times", "--ts")
    ),
    "a date and a time in two columns": log(
        "Date,Time,u,y\n" + "".join(f"2024-05-06,12:00:0{row}\n" for row in ROWS.split())
    ),
    "a date that jumps beside a time that goes on": log(
        "Date,Time,u,y\n"
        + "".join(f"2024-05-{6 + 2 * (k > 5):02d},12:00:0{row}\n" for k, row in enumerate(ROWS.split())),
        refused("row 8", "1.728e+05 s", "--range"),
    ),
    "hours": log("Stunden,u,y\n" + counted(0, 0.1 / 3600, 12)),
    "nanoseconds": log("nanoseconds,u,y\n" + counted(0, 1e8)),
    "milliseconds since 1970 that are called seconds": log(
        "time_s,u,y\n" + counted(1714996800000, 100), refused("count from 1970 in ms", "--time-unit")
    ),
    "a date beside a finer clock": log(
        "timestamp,t_ms,u,y\n"
        + "".join(
            f"2024-05-06T12:00:00,{100 * k},{row}\n"
            for k, row in enumerate(line.partition(",")[2] for line in ROWS.split())
        )
    ),
    "dates beside seconds": log("date,time_s,u,y\n" + "".join(f"2024-05-06,{row}\n" for row in ROWS.split())),
    "dates and the sampling time": log(
        HEAD + stamped([f"2024-05-06T12:00:0{t}" for t in TENTHS]), Ts=TS, input="u", output="y"
    ),
    "serial dates of Excel": log(HEAD + counted(45418.5, 0.1 / 86400, 10), SAFE),
    "a date as a number": log(HEAD + stamped([f"20240506120{k:03d}" for k in range(12)]), SAFE),
    # numbers
    "seconds since 1970": log("timestamp,u,y\n" + counted(1714996800, 0.1, 1)),
    "milliseconds since 1970": log("timestamp,u,y\n" + counted(1714996800000, 100)),
    "microseconds since 1970": log("timestamp,u,y\n" + counted(1714996800000000, 100000)),
    "nanoseconds since 1970": log("timestamp,u,y\n" + counted(1714996800000000000, 100000000)),
    "seconds since 1970 in steps of 7 ms": log("timestamp,u,y\n" + counted(1714996800, 0.007, 3), STEPS_OF_7MS),
    "milliseconds without a word": log("t,u,y\n" + counted(0, 100), SAFE),
    "steps of 10 without a word": log("t,u,y\n" + counted(0, 10), refused("--time-unit")),
    "steps of 10 with a word": log("t,u,y\n" + counted(0, 10), Right(Ts=0.01), time="t", time_unit="ms"),
    "steps of 5 us without a word": log("t,u,y\n" + counted(0, 5e-6, 6), refused("--time-unit")),
    "a clock that begins at 100 s": log("t,u,y\n" + counted(100, 0.1, 1)),
    "a clock that begins below zero": log("t,u,y\n" + counted(-0.5, 0.1, 1)),
    "a clock in exponents": log("t,u,y\n" + stamped([f"{k / 10:.3e}" for k in range(12)])),
    "a clock of six digits that is late": log("t,u,y\n" + stamped([f"{98765 + k / 10:.6g}" for k in range(12)]), SAFE),
    "a counter of 16 bits that starts again": log(
        "millis,u,y\n" + stamped([str((65000 + 100 * k) % 65536) for k in range(12)])
    ),
    "a counter of 32 bits that starts again": log(
        "micros,u,y\n" + stamped([str((4294500000 + 100000 * k) % 2**32) for k in range(12)])
    ),
    "two clocks that agree": log(
        "t_ms,time_s,u,y\n" + "".join(f"{100 * k},{row}\n" for k, row in enumerate(ROWS.split()))
    ),
    "two clocks that do not agree": log(
        "t_ms,time_s,u,y\n" + "".join(f"{200 * k},{row}\n" for k, row in enumerate(ROWS.split())),
        refused("--time"),
    ),
    "a clock of the rig that runs back to an earlier run": log(
        "t,u,y\n" + ROWS + ROWS,
        Right(U + U, Y + Y),  # two experiments
    ),
    "a frequency that rises evenly is no clock": log("frequency,u,y\n" + ROWS, refused("--ts")),
    "a clock that stands still": log("t,u,y\n" + stamped(["3.5"] * 12), SAFE, time="t"),
    "a clock given twice": log("t,u,y\n" + ROWS, refused("--ts"), time="t", Ts=0.2),
    "a sampling time below zero": log("u,y\n" + PAIRS, refused("--ts"), Ts=-0.1),
    "a sampling time that is no number": log("u,y\n" + PAIRS, refused("--ts"), Ts=float("nan")),
    "a sampling time that is infinite": log("u,y\n" + PAIRS, refused("--ts"), Ts=float("inf")),
    # faults
    "a sample is lost": log("t,u,y\n" + with_row(6, ""), LOST),
    "six samples are lost": log(
        "t,u,y\n" + "".join(ROWS.splitlines(keepends=True)[:4] + ROWS.splitlines(keepends=True)[10:]),
        refused("row 6", "--range"),
    ),
    "a stamp repeats": log("t,u,y\n" + with_row(6, "0.5,2,2\n0.5,2,2")),
    "a stamp repeats with other values": log("t,u,y\n" + with_row(6, "0.5,2,2\n0.5,9,9")),
    "each stamp stands twice": log("t,u,y\n" + stamped([f"{k // 2 / 10:.1f}" for k in range(12)]), refused("--ts")),
    "two rows are swapped": log(
        "t,u,y\n" + with_row(5, "", with_row(6, "0.5,2,2\n0.4,2,0.25")), refused("row 7", "time must increase")
    ),
    "all rows run back": log("t,u,y\n" + "".join(reversed(ROWS.splitlines(keepends=True))), SAFE, time="t"),
    "a stamp is empty": log("t,u,y\n" + with_row(6, ",2,2"), refused("row 7", "empty")),
    "a stamp is a word": log("t,u,y\n" + with_row(6, "start,2,2"), refused("row 7", "'start'"), time="t"),
    "stamps within a thousandth": log("t,u,y\n" + stamped([f"{k / 10 + (k % 3) * 1e-4:.4f}" for k in range(12)])),
    "stamps with a jump of an hour": log("t,u,y\n" + with_row(12, "3601.1,1,-1.75"), refused("row 13", "--range")),
    "a stamp of 1e300": log("t,u,y\n" + with_row(12, "1e300,1,-1.75"), refused("row 13")),
    "a stamp of 1e18": log("t,u,y\n" + with_row(12, "1e18,1,-1.75"), refused("column 't'")),
    "a stamp that is infinite": log("t,u,y\n" + with_row(6, "inf,2,2"), refused("row 7", "infinite")),
    "seconds with a decimal comma among points": log(
        "t;u;y\n" + with_row(6, "0,5;2;2", ROWS.replace(",", ";")), refused("row 7")
    ),
    "the record of a range": log("t,u,y\n" + "9,9,9\n" + ROWS, refused("row 3", "time must increase")),
}
