"""NumPy, MATLAB and Parquet files, made here from the same numbers, and the names of files."""

import datetime
import io
import zipfile

import numpy as np
import polars
import scipy.io

from corpus._log import ROWS, SAFE, Log, Refused, Right, T, U, Y, log, refused

t, u, y = (np.array(values) for values in (T, U, Y))
BRIDGED = Right(y=(*Y[:5], 1.875, *Y[6:]))
Y_GAP = np.where(t == 0.5, np.nan, y)
OTHER = np.arange(12.0) * np.arange(12.0)  # of a neighbouring file, which is not asked for


def npz(**arrays: object) -> bytes:
    """The bytes of np.savez."""
    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def npy(array: np.ndarray, version: tuple[int, int] | None = None) -> bytes:
    """The bytes of np.save."""
    file = io.BytesIO()
    np.lib.format.write_array(file, array, version)
    return file.getvalue()


def mat(**variables: object) -> bytes:
    """The bytes of MATLAB's save -v6, by SciPy."""
    file = io.BytesIO()
    scipy.io.savemat(file, variables)
    return file.getvalue()


def parquet(**columns: object) -> bytes:
    """The bytes of a Parquet file."""
    file = io.BytesIO()
    polars.DataFrame(columns).write_parquet(file)
    return file.getvalue()


def stated(Ts: float) -> bytes:
    """A Parquet file without a clock whose header states a sampling time."""
    file = io.BytesIO()
    polars.DataFrame({"u": OTHER, "y": OTHER[::-1]}).write_parquet(file, metadata={"qpal": f'{{"Ts": {Ts}}}'})
    return file.getvalue()


def of(content: bytes, suffix: str, answer: Right | Refused = Right(), **options: object) -> Log:  # noqa: B008
    """An entry of this suffix."""
    return log(content, answer, f"a.{suffix}", **options)


NUMBERED = {"time": "1", "input": "2", "output": "3"}
START = datetime.datetime(2024, 5, 6, 12)
DATES = [START + datetime.timedelta(milliseconds=100 * k) for k in range(12)]
PARQUET = parquet(t=t, u=u, y=y)
NEIGHBOUR = parquet(t=t, u=OTHER, y=OTHER[::-1])
RIG_CSV = ("t,u,y\n" + ROWS).encode()
OTHER_CSV = b"t,u,y\n0,1,1\n1,2,3\n2,3,2\n"

LOGS: dict[str, Log] = {
    "npz": of(npz(t=t, u=u, y=y), "npz"),
    "npz, compressed": of((lambda f: (np.savez_compressed(f, t=t, u=u, y=y), f.getvalue())[1])(io.BytesIO()), "npz"),
    "npz with a sampling time": of(npz(Ts=0.1, u=u, y=y), "npz", SAFE),
    "npz of float32": of(npz(t=t, u=u.astype("f4"), y=y.astype("f4")), "npz"),
    "npz of big-endian numbers": of(npz(t=t.astype(">f8"), u=u.astype(">f8"), y=y.astype(">f8")), "npz"),
    "npz of whole numbers": of(
        npz(t=t, u=(2 * u).astype("i2"), y=(4 * y).astype("i4")), "npz", Right(tuple(2 * u), tuple(4 * y))
    ),
    "npz of columns (N, 1)": of(npz(t=t[:, None], u=u[:, None], y=y[:, None]), "npz"),
    "npz of rows (1, N)": of(npz(t=t[None], u=u[None], y=y[None]), "npz"),
    "npz in Fortran order": of(npz(x=np.asfortranarray(np.column_stack([t, u, y]))), "npz", SAFE),
    "npz of half precision": of(npz(t=t, u=u.astype("f2"), y=y.astype("f2")), "npz"),
    "npz of dates": of(npz(t=np.array(DATES, dtype="M8[us]"), u=u, y=y), "npz"),
    "npz with texts beside": of(npz(t=t, u=u, y=y, rig=np.array(["seven"])), "npz"),
    "npz of other lengths": of(npz(t=t, u=u, y=y[:-1]), "npz", refused("y")),
    "npz with NaN": of(npz(t=t, u=u, y=Y_GAP), "npz", BRIDGED, missing="mark"),
    "npz of complex numbers": of(
        npz(t=t, u=u, y=y + 1j), "npz", refused("left out what is no signal: y", "left for the output")
    ),
    "npz of an empty vector": of(npz(t=t[:0], u=u[:0], y=y[:0]), "npz", refused("")),
    "npz of nothing": of(npz(), "npz", refused("")),
    "npz cut": of(npz(t=t, u=u, y=y)[:-100], "npz", refused("not a readable npz")),
    "npz of pickled objects": of(npz(t=t, u=np.array([{}] * 12, dtype=object), y=y), "npz", refused("")),
    "zip called npz": of(
        (lambda f: (zipfile.ZipFile(f, "w").close(), f.getvalue())[1])(io.BytesIO()), "npz", refused("")
    ),
    "npy of three columns": of(npy(np.column_stack([t, u, y])), "npy", **NUMBERED),
    "npy of three rows": of(npy(np.stack([t, u, y])), "npy", **NUMBERED),
    "npy of records": of(
        npy(np.array(list(zip(t, u, y, strict=True)), dtype=[("t", "f8"), ("u", "f8"), ("y", "f8")])), "npy"
    ),
    "npy of version 3": of(npy(np.column_stack([t, u, y]), (3, 0)), "npy", **NUMBERED),
    "npy of three dimensions": of(npy(np.zeros((3, 4, 5))), "npy", refused("")),
    "npy whose shape is too large": of(
        npy(np.column_stack([t, u, y])).replace(b"(12, 3)", b"(92, 3)"), "npy", refused("npy")
    ),
    "npy whose shape is far too large": of(npy(t).replace(b"(12,), }      ", b"(99999999,), }"), "npy", refused("npy")),
    "mat": of(mat(t=t, u=u, y=y), "mat"),
    "mat of rows": of(mat(t=t[None], u=u[None], y=y[None]), "mat"),
    "mat of one matrix": of(mat(x=np.column_stack([t, u, y])), "mat", SAFE),
    "mat of a struct": of(mat(log={"t": t, "u": u, "y": y}), "mat", SAFE, input="log.u", output="log.y", time="log.t"),
    "mat of a struct with a sampling time": of(
        mat(d={"u": u, "y": y, "Ts": 0.1}), "mat", SAFE, input="d.u", output="d.y"
    ),
    "mat of whole numbers": of(
        mat(t=t, u=(2 * u).astype("i2"), y=(4 * y).astype("i2")), "mat", Right(tuple(2 * u), tuple(4 * y))
    ),
    "mat with texts": of(mat(t=t, u=u, y=y, rig="seven"), "mat"),
    "mat with NaN": of(mat(t=t, u=u, y=Y_GAP), "mat", BRIDGED, missing="mark"),
    "mat with infinite": of(mat(t=t, u=u, y=np.where(t == 0.5, np.inf, y)), "mat", refused("y", "infinite")),
    "mat of a logical input": of(mat(t=t, u=u > 0, y=y), "mat", Right(u=tuple((u > 0).astype(float)))),
    "mat of other lengths": of(mat(t=t, u=u, y=y[:-1]), "mat", refused("y")),
    "mat cut": of(mat(t=t, u=u, y=y)[:-40], "mat", refused("not a readable MAT")),
    "mat of texts alone": of(mat(a="b"), "mat", refused("")),
    "parquet": of(PARQUET, "parquet"),
    "parquet with dates": of(parquet(t=DATES, u=U, y=Y), "parquet"),
    "parquet with durations": of(parquet(t=[when - START for when in DATES], u=U, y=Y), "parquet"),
    "parquet with booleans": of(
        parquet(t=T, u=[v > 0 for v in U], y=Y), "parquet", Right(u=tuple(float(v > 0) for v in U))
    ),
    "parquet with a null": of(
        parquet(t=T, u=U, y=[None if v == 2.0 else v for v in Y]), "parquet", BRIDGED, missing="mark"
    ),
    "parquet with words beside": of(parquet(t=T, u=U, y=Y, rig=["7"] * 12), "parquet"),
    "parquet of numbers as texts": of(parquet(t=T, u=[str(v) for v in U], y=Y), "parquet", SAFE),
    "parquet of float32": of(parquet(t=t, u=u.astype("f4"), y=y.astype("f4")), "parquet"),
    "parquet with structs": of(
        parquet(t=T, m=[{"u": a, "y": b} for a, b in zip(U, Y, strict=True)]),
        "parquet",
        SAFE,
        input="m.u",
        output="m.y",
    ),
    "parquet with lists": of(parquet(t=T, u=U, y=[[v] for v in Y]), "parquet"),
    "parquet of no rows": of(parquet(t=t[:0], u=u[:0], y=y[:0]), "parquet", refused("no rows")),
    "parquet cut": of(PARQUET[:-9], "parquet", refused("not a readable Parquet")),
    "parquet whose end is noise": of(
        PARQUET[:-60] + bytes(range(52)) + PARQUET[-8:], "parquet", refused("not a readable Parquet")
    ),
    "a text called parquet": of(RIG_CSV, "parquet", refused("not a readable Parquet")),
    "a text called mat": of(RIG_CSV, "mat", refused("not a readable MAT")),
    "a parquet called csv": of(PARQUET, "csv", refused("not a text file")),
    "a suffix that nobody knows": of(RIG_CSV, "dta", refused("'.dta'")),
    "no suffix": log(RIG_CSV, refused("suffix"), "rig"),
    "a suffix in capital letters": log(RIG_CSV, file="RIG.CSV"),
    # names of files
    "a Parquet name with brackets beside the name that they match": log(
        PARQUET, file="log[1].parquet", beside={"log1.parquet": NEIGHBOUR}
    ),
    "a Parquet name with a star beside names that it matches": log(
        PARQUET, file="log*.parquet", beside={"log1.parquet": NEIGHBOUR}
    ),
    "a Parquet name with a question mark": log(PARQUET, file="log?.parquet", beside={"log1.parquet": NEIGHBOUR}),
    "a Parquet name with brackets beside a header that is not its own": log(
        parquet(u=U, y=Y),
        refused("--ts"),
        file="log[1].parquet",
        beside={"log1.parquet": stated(7.0)},
    ),
    "a CSV name with brackets": log(RIG_CSV, file="log[1].csv", beside={"log1.csv": OTHER_CSV}),
    "a CSV name with a star": log(RIG_CSV, file="log*.csv", beside={"log1.csv": OTHER_CSV}),
    "a name with blanks and a percent sign": log(RIG_CSV, file="my log 100%20.csv"),
    "a name of another alphabet": log(RIG_CSV, file="\u8a66\u9a13 \u00fc.csv"),
    "a name that begins with a dash": log(RIG_CSV, file="-rf.csv"),
    "a name that looks like a URL": log(PARQUET, file="file:1.parquet"),
    "a name with a brace": log(PARQUET, file="log{1,2}.parquet", beside={"log1.parquet": NEIGHBOUR}),
}
