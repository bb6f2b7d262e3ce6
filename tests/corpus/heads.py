"""What stands above the numbers: names, units in the header or the second row, comments, preambles; and encodings."""

import math

from corpus._log import PAIRS, ROWS, SAFE, SEMI, TABS, TS, Log, Right, U, Y, log, refused, stamped, with_row

DEG = Right(y=tuple(math.radians(y) for y in Y))
MILLI = Right(u=tuple(u / 1000 for u in U))
BOTH = Right(u=MILLI.u, y=DEG.y)
LATIN_DEGREES = "t [s];u [V];winkel [\u00b0]\n".encode("latin-1") + SEMI.encode()
MS = stamped("0 100 200 300 400 500 600 700 800 900 1000 1100")
SWAPPED = "".join("{2},{1},{0}\n".format(*row.split(",")) for row in ROWS.split())
YU = "".join("{1},{0}\n".format(*row.split(",")) for row in PAIRS.split())

LOGS: dict[str, Log] = {
    # units
    "units in brackets": log("t [s],u [V],y [deg]\n" + ROWS, DEG),
    "units in round brackets": log("Time (s),Voltage (mV),Angle (deg)\n" + ROWS, BOTH),
    "units behind a slash": log("t/s;u/mV;phi/rad\n" + ROWS.replace(",", ";"), MILLI, output="phi/rad", input="u/mV"),
    "units behind an underscore": log("time_s,voltage_mV,angle_deg\n" + ROWS, BOTH),
    "units in the second row": log("time,u,y\ns,mV,deg\n" + ROWS, BOTH),
    "units in brackets in the second row": log("time;u;y\n[s];[mV];[deg]\n" + ROWS.replace(",", ";"), BOTH),
    "units in the second row with an empty cell": log("time,u,y\ns,,deg\n" + ROWS, DEG),
    "units with a degree sign": log("t [s],u [V],y [\u00b0]\n" + ROWS, DEG),
    "units with a degree sign in latin-1": log(LATIN_DEGREES, DEG),
    "a dash for no unit": log("time,u,y\ns,-,-\n" + ROWS),
    "milliseconds in the header": log("Time [ms],u,y\n" + MS),
    "milliseconds in the second row": log("Time,u,y\nms,V,V\n" + MS),
    "milliseconds in the name": log("millis,u,y\n" + MS),
    "milliseconds in capital letters": log("TIME_MS,U_V,Y\n" + MS),
    "milliseconds written in the header, seconds in the second row": log(
        "Time [ms],u,y\ns,V,V\n" + ROWS, refused("Time [ms]")
    ),
    "microseconds": log("t_us,u,y\n" + MS.replace("00,", "00000,").replace("0,0.5,1.25", "0,0.5,1.25"), SAFE),
    "minutes": log(
        "t [min];u;y\n" + "".join(f"{k};{u:g};{y:g}\n" for k, (u, y) in enumerate(zip(U, Y, strict=True))),
        Right(Ts=60.0),
    ),
    "a percent sign": log("t [s],duty [%],angle [rad]\n" + ROWS, Right(u=tuple(u / 100 for u in U))),
    "rpm": log(
        "t [s],u [V],position [rad],speed [rpm]\n" + ROWS.replace("\n", ",7\n"), input="u [V]", output="position [rad]"
    ),
    "an unknown unit stays as it is": log("t [s],u [V],y [furlong]\n" + ROWS),
    "counts stay as they are": log("t [s],u [V],adc [counts]\n" + ROWS),
    "a unit of time that is none": log("t [V],u,y\n" + ROWS, refused("no unit of time"), time="t [V]"),
    # columns
    "columns in another order": log("y,u,t\n" + SWAPPED),
    "two columns in the other order": log("y,u\n" + YU, Ts=TS),
    "two columns called output and input": log("output,input\n" + YU, Ts=TS),
    "two columns called angle and voltage": log("angle_rad,voltage_V\n" + YU, Ts=TS),
    "two columns called Output and Input with units": log("Output [V],Input [V]\n" + YU, Ts=TS),
    "two columns called Ausgang and Eingang": log("Ausgang,Eingang\n" + YU, SAFE, Ts=TS),
    "two columns called y1 and u1": log("y1,u1\n" + YU, Ts=TS),
    "two columns called y_meas and u_cmd": log("y_meas,u_cmd\n" + YU, Ts=TS),
    "two columns called position and setpoint": log("position,setpoint\n" + YU, Ts=TS),
    "two columns that say nothing": log("a,b\n" + PAIRS, refused("'a' and 'b'", "--input", "--output"), Ts=TS),
    "the columns are named": log("when,a,b\n" + ROWS, input="a", output="b", time="when"),
    "a name with blanks": log("Time in s,Motor voltage in V,Arm angle in rad\n" + ROWS, SAFE),
    "names of two words": log("elapsed time,motor voltage,joint angle\n" + ROWS),
    "names in capital letters": log("T,U,Y\n" + ROWS),
    "a name twice": log("t,u,u\n" + ROWS, refused("'u', 'u 2'", "--input")),
    "three outputs": log("t,u,y1,y2\n" + ROWS.replace("\n", ",7\n").replace("1.25,7", "1.25,8"), SAFE),
    "German units behind in": log("Zeit in s;Spannung in V;Winkel in Grad\n" + SEMI, DEG),
    "a German degree sign behind in": log("Zeit in s;Spannung in V;Winkel in \u00b0\n" + SEMI, DEG),
    "Spanish degrees": log("t,u,angle (grados)\n" + ROWS, DEG),
    "French degrees": log("t,u,angle [degr\u00e9s]\n" + ROWS, DEG),
    "a unit that is not known behind in": log("Zeit in s;Spannung in V;Winkel in Schritten\n" + SEMI),
    "an input and no output": log(
        "t,u\n" + "".join(row.rpartition(",")[0] + "\n" for row in ROWS.split()), refused("left for the output")
    ),
    "an index in front, as pandas writes it": log(
        ",t,u,y\n" + "".join(f"{k},{row}\n" for k, row in enumerate(ROWS.split()))
    ),
    "an index in front and the time behind": log(
        ",u,y,time_s\n"
        + "".join(
            "{},{},{},{}\n".format(k, *(row.split(",")[j] for j in (1, 2, 0))) for k, row in enumerate(ROWS.split())
        )
    ),
    "a sample number and no clock": log(
        "n,u,y\n" + "".join(f"{k},{row}\n" for k, row in enumerate(PAIRS.split())), refused("--ts")
    ),
    "a sample number and the sampling time": log(
        "n,u,y\n" + "".join(f"{k},{row}\n" for k, row in enumerate(PAIRS.split())), Ts=TS
    ),
    "no names": log(ROWS, time="1", input="2", output="3"),
    "names that are numbers": log("time,1,2\n" + ROWS, input="1", output="2"),
    "a column that is not there": log("t,u,y\n" + ROWS, refused("'angle'", "t, u, y"), output="angle"),
    "the same column twice": log("t,u,y\n" + ROWS, refused("y"), input="y", output="y"),
    # above the table
    "comments with a hash": log("# rig 7\n# 2024-05-06\nt,u,y\n" + ROWS),
    "comments with a percent sign": log("% rig 7\nt,u,y\n" + ROWS),
    "comments between the rows": log("t,u,y\n" + with_row(3, "# the supply was switched on\n0.2,-1,-0.5")),
    "names behind a hash": log("# t u y\n" + ROWS.replace(",", " "), file="a.txt"),
    "names behind a hash and commas": log("# t,u,y\n" + ROWS),
    "comments with two slashes": log("// rig 7\n// second run\nt,u,y\n" + ROWS, SAFE),
    "a line of text above the names": log("Rig 7 of the laboratory\nt,u,y\n" + ROWS, SAFE),
    "a table of settings above the names": log("rig;7\noperator;Meyer\n\nt;u;y\n" + ROWS.replace(",", ";"), SAFE),
    "settings with numbers above the names": log("gain,2.5\nrate,10\n\nt,u,y\n" + ROWS, SAFE),
    "empty rows above the names": log("\n\n\nt,u,y\n" + ROWS),
    "a sampling time in our header that the clock contradicts": log(
        '# qpal: {"Ts": 1e9}\nt,u,y\n' + ROWS, refused("1e+09 s", "'t' steps by 0.1 s", "--ts")
    ),
    "a sampling time in our header and no clock": log('# qpal: {"Ts": 0.1}\nu,y\n' + PAIRS),
    "a sampling time of 1e9 s in our header": log('# qpal: {"Ts": 1e9}\nu,y\n' + PAIRS, Right(Ts=1e9, or_refused=True)),
    "a negative sampling time in our header": log('# qpal: {"Ts": -1}\nu,y\n' + PAIRS, refused("--ts")),
    "a sampling time in our header that is a text": log('# qpal: {"Ts": "0.1"}\nu,y\n' + PAIRS, SAFE),
    "a header of ours that is a list": log("# qpal: [1, 2]\nt,u,y\n" + ROWS),
    "a header of ours that is cut": log('# qpal: {"Ts": 0.1, "jo\nt,u,y\n' + ROWS),
    # encodings and line ends
    "byte order mark": log("\ufefft,u,y\n" + ROWS),
    "byte order mark before a quote": log('\ufeff"t","u","y"\n' + ROWS),
    "UTF-16, little end first": log(("\ufefft\tu\ty\n" + TABS).encode("utf-16-le"), file="a.txt"),
    "UTF-16, big end first": log(("\ufefft,u,y\n" + ROWS).encode("utf-16-be")),
    "UTF-16 without its mark": log(("t,u,y\n" + ROWS).encode("utf-16-le"), refused("not a text file")),
    "UTF-32": log(("t,u,y\n" + ROWS).encode("utf-32"), SAFE),
    "CR LF": log(("t,u,y\n" + ROWS).replace("\n", "\r\n")),
    "CR alone": log(("t,u,y\n" + ROWS).replace("\n", "\r")),
    "CR CR LF": log(("t,u,y\n" + ROWS).replace("\n", "\r\r\n")),
    "mixed line ends": log("t,u,y\r\n" + with_row(3, "0.2,-1,-0.5\r")),
    "no line end at the end": log(("t,u,y\n" + ROWS)[:-1]),
    "blank lines at the end": log("t,u,y\n" + ROWS + "\n\n   \n"),
    "the mark of the end of a file of DOS": log("t,u,y\n" + ROWS + "\x1a", SAFE),
    "form feeds between pages": log("t,u,y\n" + with_row(3, "\f0.2,-1,-0.5")),
    "names in GB 2312": log("\u65f6\u95f4(s),u(V),\u8f6c\u89d2(rad)\n".encode("gb2312") + ROWS.encode(), SAFE),
    "latin-1 in a name": log("t,u,y,\u00b5\n".encode("latin-1") + ROWS.replace("\n", ",1\n").encode()),
    "names of another alphabet": log(
        "\u6642\u9593,\u5165\u529b,\u51fa\u529b\n" + ROWS,
        time="\u6642\u9593",
        input="\u5165\u529b",
        output="\u51fa\u529b",
    ),
    "a name of 5,000 letters": log(f"t,u,{'y' * 5000}\n" + ROWS, input="u", output="y" * 5000),
    "a blank that does not break in a cell": log("t,u,y\n" + with_row(3, "0.2,-1,-0.5\u00a0"), SAFE),
}
