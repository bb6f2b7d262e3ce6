"""Files as programs export them: oscilloscopes, LabVIEW, MATLAB, pandas, R, Excel in several languages, loggers."""

from corpus._log import PAIRS, ROWS, SAFE, SEMI, TABS, TS, Log, Right, U, Y, log, refused, stamped


def printed(form: str) -> str:
    """The rows as a program prints numbers."""
    return "".join(form.format(*map(float, row.split(","))) for row in ROWS.split())


BY_NUMBER = {"file": "a.txt", "time": "1", "input": "2", "output": "3"}  # a table without names
LABVIEW = """\
LabVIEW Measurement
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t.
Multi_Headings\tNo
X_Columns\tOne
Time_Pref\tRelative
Operator\tMeyer
Date\t2024/05/06
Time\t12:00:00.0000000
***End_of_Header***

Channels\t2
Samples\t12\t12
Date\t2024/05/06\t2024/05/06
Time\t12:00:00\t12:00:00
Y_Unit_Label\tVolts\tVolts
X_Dimension\tTime\tTime
X0\t0.0E+0\t0.0E+0
Delta_X\t0.1\t0.1
***End_of_Header***
X_Value\tu\ty\tComment
"""
TEKTRONIX = """\
Model,TBS1102
Firmware Version,v4.06
Record Length,12
Sample Interval,0.1
Vertical Units,V,V
Horizontal Units,s

TIME,CH1,CH2
"""
RIGOL = "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,0.000000e+00,1.000000e-01\n"
TEK_OLD = [
    "Record Length,1.200000e+01,,0.0,0.5",
    "Sample Interval,1.000000e-01,,0.1,0.5",
    "Trigger Point,0.000000e+00,,0.2,-1",
    *(f",,,{row.rpartition(',')[0]}" for row in ROWS.split()[3:]),
]
PICO = "Time,Channel A,Channel B\n(s),(V),(V)\n\n"
SALEAE = "Time [s],Channel 0,Channel 1\n"
AFTER_THE_FIRST = Right(U[1:], Y[1:])  # a capture may begin within a line, which no clock shows here
VOLTS = {"input": "CH1", "output": "CH2"}

LOGS: dict[str, Log] = {
    "NumPy savetxt": log(printed("{:.18e} {:.18e} {:.18e}\n"), **BY_NUMBER),
    "NumPy savetxt with a header": log("# t u y\n" + printed("{:.18e} {:.18e} {:.18e}\n"), file="a.txt"),
    "pandas to_csv": log(",time_s,u,y\n" + "".join(f"{k},{row}\n" for k, row in enumerate(ROWS.split()))),
    "pandas to_csv with an index of times": log("time_s,u,y\n" + ROWS),
    "pandas to_csv with dates as index": log(
        ",u,y\n"
        + stamped(
            [f"2024-05-06 12:00:0{k / 10:.6f}" for k in range(10)] + ["2024-05-06 12:00:01.0", "2024-05-06 12:00:01.1"]
        ),
    ),
    "pandas to_csv with columns of two levels": log("t,motor,motor\n,u,y\n" + ROWS, refused("motor 2")),
    "polars write_csv": log("time_s,u,y\n" + ROWS),
    "R write.table": log(
        '"t" "u" "y"\n' + "".join(f'"{k + 1}" {row.replace(",", " ")}\n' for k, row in enumerate(ROWS.split())),
        SAFE,
        file="a.txt",
    ),
    "R write.csv": log('"","t","u","y"\n' + "".join(f'"{k + 1}",{row}\n' for k, row in enumerate(ROWS.split()))),
    "R write.csv2": log('"";"t";"u";"y"\n' + "".join(f'"{k + 1}";{row}\n' for k, row in enumerate(SEMI.split()))),
    "MATLAB writematrix": log(ROWS, time="1", input="2", output="3"),
    "MATLAB writetable": log("t,u,y\n" + ROWS),
    "MATLAB writetimetable": log("Time,u,y\n" + stamped([f"{k / 10:g} sec" for k in range(12)]), SAFE),
    "MATLAB save -ascii": log(
        printed("   {:.7e}   {:.7e}   {:.7e}\n"),
        **BY_NUMBER,
    ),
    "MATLAB tabs and Inf": log(
        "t\tu\ty\n" + TABS.replace("\t2\t2", "\t2\tInf"), refused("row 7", "infinite"), file="a.txt"
    ),
    "Octave text": log(
        "# Created by Octave 8.4.0\n# name: x\n# type: matrix\n# rows: 12\n# columns: 3\n" + ROWS.replace(",", " "),
        **BY_NUMBER,
    ),
    "LabVIEW measurement file": log(LABVIEW + TABS, SAFE, file="a.txt"),
    "LabVIEW spreadsheet": log(
        printed("{:.3f}\t{:.3f}\t{:.3f}\n"),
        **BY_NUMBER,
    ),
    "LabVIEW spreadsheet in German": log(
        printed("{:.3f}\t{:.3f}\t{:.3f}\r\n").replace(".", ","),
        Right(or_refused=True),
        **BY_NUMBER,
    ),
    "Excel, English": log("t,u,y\r\n" + ROWS.replace("\n", "\r\n")),
    "Excel, German": log("\ufefft;u;y\r\n" + SEMI.replace("\n", "\r\n")),
    "Excel, French": log(
        "temps (s);u (V);y (V)\r\n".encode("latin-1") + SEMI.replace("\n", "\r\n").encode(),
        SAFE,
        time="temps (s)",
        input="u (V)",
        output="y (V)",
    ),
    "Excel, Swiss": log("t;u;y\r\n" + ROWS.replace(",", ";").replace("\n", "\r\n")),
    "Excel, Unicode text": log(("\ufefft\tu\ty\r\n" + TABS.replace("\n", "\r\n")).encode("utf-16-le"), file="a.txt"),
    "Excel, Unicode text in German": log(
        ("\ufefft\tu\ty\r\n" + SEMI.replace(";", "\t").replace("\n", "\r\n")).encode("utf-16-le"), file="a.txt"
    ),
    "Excel, two tables beside each other": log("t,u,y,,t,u,y\n" + "".join(f"{row},,{row}\n" for row in ROWS.split())),
    "Excel, a sum below the table": log("t;u;y\n" + ROWS.replace(",", ";") + ";;4.75\n", SAFE),
    "Excel, a column too narrow": log(
        "t;u;y\n" + ROWS.replace(",", ";").replace(";3.5", ";###"), refused("row 8", "'###'")
    ),
    "Excel, a number that became a date": log(
        "t;u;y\n" + ROWS.replace(",", ";").replace(";3.5", ";03. Mai"), refused("row 8", "'03. Mai'")
    ),
    "Excel called csv": log(b"PK\x03\x04\x14\0\x06\0\x08\0\0\0!\0" + bytes(200), refused("not a text file")),
    "LibreOffice with quotes": log('"t";"u";"y"\n' + ROWS.replace(",", ";")),
    "Tektronix with a preamble": log(TEKTRONIX + ROWS, SAFE, **VOLTS),
    "Tektronix with values beside the preamble": log("\n".join(TEK_OLD) + "\n", SAFE),
    "Rigol": log(RIGOL + "".join(f"{k},{row},,\n" for k, row in enumerate(PAIRS.split())), SAFE, Ts=TS, **VOLTS),
    "Rohde and Schwarz": log("in s,CH1 in V,CH2 in V\n" + ROWS, SAFE),
    "Keysight with units below": log("x-axis,1,2\nsecond,Volt,Volt\n" + ROWS, SAFE, input="1", output="2"),
    "PicoScope": log(PICO + ROWS, SAFE, input="Channel A", output="Channel B"),
    "PicoScope in milliseconds": log(
        PICO.replace("(s)", "(ms)") + stamped([str(100 * k) for k in range(12)]),
        SAFE,
        input="Channel A",
        output="Channel B",
    ),
    "Saleae": log(SALEAE + ROWS, input="Channel 0", output="Channel 1"),
    "dSPACE ControlDesk": log("time;input;output\n" + ROWS.replace(",", ";")),
    "a data logger with seconds and words": log(
        "No.,Time,u,y,Alarm\n" + "".join(f"{k + 1},{row},LLLL\n" for k, row in enumerate(ROWS.split()))
    ),
    "a servo's monitor": log(
        "t_ms,goal_deg,angle_deg,load\n"
        + "".join(
            f"{100 * k},{u * 180 / 3.141592653589793!r},{y * 180 / 3.141592653589793!r},{k % 3}\n"
            for k, (u, y) in enumerate(zip(U, Y, strict=True))
        )
    ),
    "PX4, microseconds": log("timestamp,u,y\n" + stamped([str(112345678 + 100000 * k) for k in range(12)]), SAFE),
    "rosbag to csv": log(
        "%time,field.u,field.y\n" + stamped([str(1714996800000000000 + 100000000 * k) for k in range(12)]), SAFE
    ),
    "Arduino plotter": log(
        "".join("u:{},y:{}\n".format(*row.split(",")) for row in PAIRS.split()), AFTER_THE_FIRST, file="a.txt", Ts=TS
    ),
    "a terminal program with its own times": log(
        "".join(f"12:00:0{k / 10:.3f} -> {row}\n" for k, row in enumerate(PAIRS.split()) if k < 10),
        Right(U[1:10], Y[1:10]),
        file="a.txt",
        Ts=TS,
    ),
    "Simulink scope": log("time,In1,Out1\n" + ROWS),
}
