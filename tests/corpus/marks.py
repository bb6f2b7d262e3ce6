"""Separators, decimal marks, thousands marks, quotes."""

from corpus._log import PAIRS, ROWS, SAFE, SEMI, TABS, TS, Log, Right, U, Y, log, refused, with_row

QUOTED = ROWS.replace(",", '","').replace("\n", '"\n"')[:-1]  # 0.0","0.5","1.25"
# Whole numbers on both sides of a thousand: what a mark between digits means can be seen from the others.
THOUSANDS = Right(
    (608.0, 608.0, 1234.0, 1234.0, -950.0, -950.0, 1500.0, 1500.0, 20.0, 20.0, 700.0, 800.0),
    (10.0, 20.0, 30.0, 2040.0, 2050.0, 1060.0, 70.0, 80.0, 90.0, 100.0, 1110.0, 120.0),
)
WITH_MARKS = """\
0.0;608;10
0.1;608;20
0.2;1,234;30
0.3;1,234;2,040
0.4;-950;2,050
0.5;-950;1,060
0.6;1,500;70
0.7;1,500;80
0.8;20;90
0.9;20;100
1.0;700;1,110
1.1;800;120
"""
OR_REFUSED = Right(THOUSANDS.u, THOUSANDS.y, or_refused=True)
MILLION = (  # rows whose input has two thousands marks
    "t;u;y\n0.0;1,234,567.5;1\n0.1;1,234,567.5;2\n0.2;2,000,000.25;3\n0.3;2,000,000.25;2\n0.4;1,500,000.5;1\n"
)
MILLIONS = Right((1234567.5, 1234567.5, 2000000.25, 2000000.25, 1500000.5), (1.0, 2.0, 3.0, 2.0, 1.0), or_refused=True)

LOGS: dict[str, Log] = {
    # separators
    "commas": log("t,u,y\n" + ROWS),
    "semicolons": log("t;u;y\n" + ROWS.replace(",", ";")),
    "tabs": log("t\tu\ty\n" + TABS),
    "tabs, called tsv": log("t\tu\ty\n" + TABS, file="a.tsv"),
    "tabs, called txt": log("t\tu\ty\n" + TABS, file="a.txt"),
    "one blank": log("t u y\n" + ROWS.replace(",", " "), file="a.txt"),
    "many blanks": log("  t     u     y\n" + ROWS.replace(",", "    "), file="a.dat"),
    "columns aligned at the right": log(
        "       t       u       y\n"
        + "".join("".join(f"{cell:>8}" for cell in row.split(",")) + "\n" for row in ROWS.split()),
        file="a.txt",
    ),
    "commas and blanks": log("t, u, y\n" + ROWS.replace(",", ", ")),
    "blanks around commas": log("t , u , y\n" + ROWS.replace(",", " , ")),
    "tabs and blanks": log("t \tu \ty\n" + ROWS.replace(",", " \t")),
    "bars": log("t|u|y\n" + ROWS.replace(",", "|"), SAFE),
    "colons": log("t:u:y\n" + ROWS.replace(",", ":"), SAFE),
    "the separator named in the first row, as Excel takes it": log("sep=;\nt;u;y\n" + ROWS.replace(",", ";"), SAFE),
    "a comma at the end of each row": log("t,u,y,\n" + ROWS.replace("\n", ",\n")),
    "a comma at the end of each row but not of the names": log("t,u,y\n" + ROWS.replace("\n", ",\n")),
    "four commas at the end": log("t,u,y,,,,\n" + ROWS.replace("\n", ",,,,\n")),
    "a tab at the end of each row": log("t\tu\ty\t\n" + TABS.replace("\n", "\t\n")),
    "a semicolon at the end of one row": log("t;u;y\n" + with_row(3, "0.2;-1;-0.5;", ROWS.replace(",", ";"))),
    "one row with another separator": log("t,u,y\n" + with_row(3, "0.2;-1;-0.5"), refused("row 4", "1 cell ")),
    "names with another separator": log("t;u;y\n" + ROWS, refused("cells")),
    "two cells run together": log("t,u,y\n" + with_row(3, "0.2,-1-0.5"), refused("row 4", "2 cells")),
    "a sample on two lines": log("t,u,y\n" + with_row(3, "0.2,-1,\n-0.5"), refused("row")),
    # decimal marks
    "decimal commas between semicolons": log("t;u;y\n" + SEMI),
    "decimal commas between tabs": log("t\tu\ty\n" + SEMI.replace(";", "\t"), file="a.txt"),
    "decimal commas between blanks": log(SEMI.replace(";", " "), file="a.txt", input="2", output="3", time="1"),
    "decimal commas in one column alone": log(
        "t;u;y\n"
        + "".join(f"{k};{u:g};{y:.2f}\n".replace(".", ",", 1) for k, (u, y) in enumerate(zip(U, Y, strict=True))),
        refused("row"),
        Ts=TS,
    ),
    "one cell with a decimal comma among points": log(
        "t;u;y\n" + with_row(3, "0.2;-1;-0,5", ROWS.replace(",", ";")), refused("row 4", "-0,5")
    ),
    "one cell with a point among decimal commas": log("t;u;y\n" + with_row(3, "0,2;-1;-0.5", SEMI), refused("-0.5")),
    "decimal commas between commas": log("t,u,y\n" + SEMI.replace(";", ","), refused("cells")),
    "decimal commas between commas, quoted": log(
        't,u,y\n"' + SEMI.replace(";", '","').replace("\n", '"\n"')[:-1], SAFE
    ),
    "decimal commas with three digits in every cell": log(
        "t;u;y\n0,000;0,500;1,250\n0,100;0,500;0,750\n0,200;-1,000;-0,500\n0,300;-1,000;-1,500\n",
        Right((0.5, 0.5, -1.0, -1.0), (1.25, 0.75, -0.5, -1.5)),
    ),
    "decimal commas with exponents": log(
        "t;u;y\n0,0E+0;5,0E-1;1,25E+0\n1,0E-1;5,0E-1;7,5E-1\n2,0E-1;-1,0E+0;-5,0E-1\n3,0E-1;-1,0E+0;-1,5E+0\n",
        Right((0.5, 0.5, -1.0, -1.0), (1.25, 0.75, -0.5, -1.5)),
    ),
    "a point and no digit behind it": log("t,u,y\n" + ROWS.replace(",2\n", ",2.\n")),
    "no digit before the point": log("t,u,y\n" + ROWS.replace("0.", ".")),
    "plus signs": log("t,u,y\n" + ROWS.replace(",0.5", ",+0.5").replace(",2", ",+2")),
    "exponents of Fortran": log(
        "t,u,y\n"
        + "".join(
            f"{k / 10:.1f},{u:.4E},{y:.4E}\n".replace("E", "D") for k, (u, y) in enumerate(zip(U, Y, strict=True))
        ),
        SAFE,
    ),
    "small and large e": log("t,u,y\n" + with_row(3, "2e-1,-1E0,-5e-01")),
    # thousands marks
    "thousands marks beside smaller numbers": log("t;u;y\n" + WITH_MARKS, OR_REFUSED),
    "thousands marks in one column": log(
        "t;u;y\n"
        + "".join(f"{k};{u:,.0f};{y:.0f}\n" for k, (u, y) in enumerate(zip(THOUSANDS.u, THOUSANDS.y, strict=True))),
        OR_REFUSED,
        Ts=TS,
    ),
    "thousands marks between tabs": log("t\tu\ty\n" + WITH_MARKS.replace(";", "\t"), OR_REFUSED),
    "thousands marks in quotes between commas": log(
        "t,u,y\n" + "".join('{},"{}","{}"\n'.format(*row.split(";")) for row in WITH_MARKS.split()), OR_REFUSED
    ),
    "two thousands marks and a point": log(MILLION, MILLIONS),
    "two thousands points and a comma": log(MILLION.translate({44: 46, 46: 44}), MILLIONS),
    "thousands apostrophes": log("t;u;y\n" + WITH_MARKS.replace(",", "'"), OR_REFUSED),
    "thousands blanks": log("t;u;y\n" + WITH_MARKS.replace(",", " "), OR_REFUSED),
    "thousands blanks that do not break": log("t;u;y\n" + WITH_MARKS.replace(",", "\u202f"), OR_REFUSED),
    "thousands underscores": log("t;u;y\n" + WITH_MARKS.replace(",", "_"), OR_REFUSED),
    "thousands points beside decimal commas": log(
        "t;u;y\n0,0;1.234,5;1\n0,1;1.234,5;2\n0,2;608,25;3\n0,3;608,25;2\n",
        Right((1234.5, 1234.5, 608.25, 608.25), (1.0, 2.0, 3.0, 2.0), or_refused=True),
    ),
    "thousands points alone": log(
        "t;u;y\n0,0;1.234;1\n0,1;1.234;2\n0,2;608;3\n0,3;608;2\n",
        Right((1234.0, 1234.0, 608.0, 608.0), (1.0, 2.0, 3.0, 2.0), or_refused=True),
    ),
    "thousands points beside nothing but 0": log(
        "t_ms;u;y\n" + "".join(f"{10 * k};{('2.500', '0', '1.500')[k // 3 % 3]};{k * k % 11}\n" for k in range(12)),
        refused("row 2", "'2.500'", "thousands", "'0'"),
    ),
    "three digits behind the point, and 0": log(
        "t_ms;u;y\n" + "".join(f"{10 * k};{('2.505', '0', '1.503')[k // 3 % 3]};{k * k % 11}\n" for k in range(12)),
        Right(
            tuple((2.505, 0.0, 1.503)[k // 3 % 3] for k in range(12)), tuple(float(k * k % 11) for k in range(12)), 0.01
        ),
    ),
    "thousands marks in the clock": log(
        "t [ms];u;y\n" + "".join(f"{900 + 100 * k:,};{u:g};{y:g}\n" for k, (u, y) in enumerate(zip(U, Y, strict=True))),
        SAFE,
    ),
    # quotes
    "everything quoted": log('"t","u","y"\n"' + QUOTED),
    "names quoted": log('"t","u","y"\n' + ROWS),
    "names quoted with a separator in them": log(
        '"t","u, the voltage","y"\n' + ROWS, input="u, the voltage", output="y"
    ),
    "names with doubled quotes": log('t,"u ""in""",y\n' + ROWS),
    "single quotes": log("'t','u','y'\n'" + QUOTED.replace('"', "'"), SAFE),
    "a quote that is never closed": log("t,u,y\n" + with_row(3, '0.2,"-1,-0.5'), refused("row 4", "quotes")),
    "quotes in one column alone": log(
        "t,u,y\n" + "".join('{},"{}",{}\n'.format(*row.split(",")) for row in ROWS.split())
    ),
    "quoted white space table": log('"t" "u" "y"\n' + ROWS.replace(",", " "), file="a.txt"),
    "an equals sign before quotes, against Excel": log(
        "t,u,y\n" + "".join('="{}",="{}",="{}"\n'.format(*row.split(",")) for row in ROWS.split()), SAFE
    ),
    "two columns without names": log(PAIRS, input="1", output="2", Ts=TS),
}
