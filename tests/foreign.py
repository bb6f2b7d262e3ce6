"""Files as other programs write them, at least one a format; the contract tests of readers run over this table."""

import json

import loggers
import numpy as np
import polars
import pytest
import scipy.io


def _samples(u, y):
    return [{"u": a, "y": b} for a, b in zip(u.tolist(), y.tolist(), strict=True)]


def _mcap(path, u, y):
    writer = pytest.importorskip("mcap.writer", reason="mcap is in the robot extra")
    with path.open("wb") as file:
        bag = writer.Writer(file)
        bag.start()
        channel = bag.register_channel("log", "json", bag.register_schema("log", "jsonschema", b"{}"))
        for k, sample in enumerate(_samples(u, y)):
            bag.add_message(channel, 50_000_000 * k, json.dumps(sample).encode(), 0)
        bag.finish()


def _bag(path, u, y):
    """A bag of ROS 1 or, in a .db3, of ROS 2 with a vector of two."""
    pytest.importorskip("rosbags", reason="rosbags is in the robot extra")
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    old = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_HUMBLE)
    kind = "geometry_msgs/msg/Vector3"
    folder = path.with_suffix("")
    with rosbag1.Writer(path) if old else rosbag2.Writer(folder, version=9) as bag:
        connection = bag.add_connection("/log", kind, typestore=store)
        for k, (a, b) in enumerate(zip(u.tolist(), y.tolist(), strict=True)):
            message = store.types[kind](x=a, y=b, z=0.0)
            raw = store.serialize_ros1(message, kind) if old else store.serialize_cdr(message, kind)
            bag.write(connection, 50_000_000 * k, raw)
    if not old:
        next(folder.glob("*.db3")).rename(path)


def _hdf(path, u, y):
    """As MATLAB lays out version 7.3: a block of 512 bytes in front, column vectors seen by rows."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("u", u), ("y", y)):
            file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + bytes([0, 2]) + b"IM")


# Files of input u (N,) and output y (N,) as other programs write them, by what they are called: at least one a format.
FOREIGN = {
    "table.parquet": lambda path, u, y: polars.DataFrame({"label": ["a"] * len(u), "u": u, "y": y}).write_parquet(path),
    "vectors.mat": lambda path, u, y: scipy.io.savemat(path, {"u": u[:, None], "y": y[:, None], "gain": 3.0}),
    "rows.mat": lambda path, u, y: scipy.io.savemat(path, {"u": u, "y": y}),
    "matrix.mat": lambda path, u, y: scipy.io.savemat(path, {"data": np.column_stack([u, y])}),
    "struct.mat": lambda path, u, y: scipy.io.savemat(path, {"log": {"u": u, "y": y, "gain": 3.0}}),
    "new.mat": _hdf,
    "arrays.npz": lambda path, u, y: np.savez(path, u=u, y=y[:, None], gain=3.0),
    "matrix.npy": lambda path, u, y: np.save(path, np.column_stack([u, y])),
    "samples.json": lambda path, u, y: path.write_text(json.dumps({"mass": 0.5, "entries": _samples(u, y)})),
    "columns.json": lambda path, u, y: path.write_text(json.dumps({"u": u.tolist(), "y": y.tolist()})),
    "lines.jsonl": lambda path, u, y: path.write_text("".join(json.dumps(each) + "\n" for each in _samples(u, y))),
    "rows.ndjson": lambda path, u, y: path.write_text("".join(f"{row}\n" for row in np.column_stack([u, y]).tolist())),
    "capture.log": lambda path, u, y: path.write_text(
        "boot 3\nu,y\n" + "".join(f"{a!r},{b!r}\r\n" for a, b in np.column_stack([u, y]).tolist())
    ),
    "robot.mcap": _mcap,
    "robot.bag": _bag,
    "robot.db3": _bag,
    **{
        name: lambda path, u, y, write=write: write(path, *((0.05 * np.arange(len(x)), x) for x in (u, y)))
        for name, write in loggers.WRITERS.items()
        if name != "a.csv"
    },
}
ROBOT = {"robot.mcap": ("log.u", "log.y"), "robot.bag": ("log.x", "log.y"), "robot.db3": ("log.x", "log.y")}
