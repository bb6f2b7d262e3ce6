"""Files of other programs with damaged bytes: numbers or a sentence, whatever the reader does on them.

Sound files hold what each format has beside plain vectors: structs, cells, objects, lists, messages.
"""

import importlib
import json
import struct
import tempfile
from collections.abc import Callable
from functools import cached_property
from pathlib import Path

import numpy as np

from fuzz.runner import WrongError
from sysid.base.errors import InputError
from sysid.formats import read_table

N = 40
U, Y = np.round(np.sin(np.arange(N)), 3), np.round(np.cos(np.arange(N)), 3)
START = 1_700_000_000_000_000_000  # [ns]


def mat(compressed: bool) -> Callable[[Path], None]:
    """Level 5: vectors, a struct, cells, text, a sparse and a complex matrix."""

    def write(path: Path) -> None:
        from scipy.io import savemat
        from scipy.sparse import csc_array

        content = {"u": U[:, None], "y": Y, "s": {"a": U, "b": "text"}, "z": U[:4] + 1j, "i": np.arange(9, dtype="i2")}
        content |= {"c": np.array([U[:3], "x"], dtype=object), "p": csc_array(np.diag(U[:5]))}
        savemat(path, content, do_compression=compressed)

    return write


def element(tag: int, data: bytes) -> bytes:
    """A data element of level 5: tag, length, data padded to 8 bytes."""
    return struct.pack("<II", tag, len(data)) + data + bytes(-len(data) % 8)


def mat_object(path: Path) -> None:
    """Level 5 with an object of a MATLAB class, as MATLAB saves a timeseries, beside a vector."""
    from scipy.io import savemat

    reference = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 6, 1)) + element(1, b"")
    reference += element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1))
    content = element(6, struct.pack("<II", 17, 0)) + element(1, b"tout") + element(1, b"MCOS")
    content += element(1, b"timeseries") + element(14, reference)
    savemat(path, {"u": U[:4]})
    raw = path.read_bytes()
    path.write_bytes(raw[:128] + element(14, content) + raw[128:])


def mat_4(path: Path) -> None:
    """Level 4."""
    from scipy.io import savemat

    savemat(path, {"u": U, "y": Y}, format="4")


def mat_73(path: Path) -> None:
    """HDF5 behind MATLAB's block, with a struct, a cell and a compressed data set."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("u", U), ("y", Y)):
            file.create_dataset(name, data=values[None], chunks=(1, 20), compression="gzip")
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file.create_group("s")["a"] = U
        file["cell"] = np.array([file["u"].ref], dtype=h5py.ref_dtype)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def parquet(**options: str) -> Callable[[Path], None]:
    """Numbers, times, texts, lists and structs."""

    def write(path: Path) -> None:
        import polars

        table = {"u": U, "y": Y, "k": np.arange(N), "s": ["a", "b"] * (N // 2), "on": U > 0, "l": [[1, 2]] * N}
        frame = polars.DataFrame(table).with_columns(polars.struct("u", "y").alias("pair"))
        frame.write_parquet(path, metadata={"qpal": "{}"}, **options)  # type: ignore[arg-type]

    return write


def mcap(path: Path) -> None:
    """Messages in JSON."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        bag = Writer(file, chunk_size=512)
        bag.start()
        channel = bag.register_channel("/motor", "json", bag.register_schema("m", "jsonschema", b"{}"))
        for k in range(N):
            bag.add_message(channel, START + k * 10**7, json.dumps({"u": U[k], "y": [Y[k]]}).encode(), 0)
        bag.finish()


def bag(path: Path) -> None:
    """ROS 1 (.bag), or the file of ROS 2 (.db3)."""
    import rosbags.rosbag1
    import rosbags.rosbag2
    from rosbags.typesys import Stores, get_typestore

    one = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if one else Stores.ROS2_HUMBLE)
    kind = "geometry_msgs/msg/Vector3"
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / path.name
        writer_of_format = rosbags.rosbag1.Writer(place) if one else rosbags.rosbag2.Writer(place, version=9)
        with writer_of_format as writer:
            topic = writer.add_connection("/log", kind, typestore=store)
            serialize = store.serialize_ros1 if one else store.serialize_cdr
            for k in range(N):
                writer.write(topic, START + k * 10**7, serialize(store.types[kind](x=U[k], y=Y[k], z=0.0), kind))
        path.write_bytes((place if one else next(place.glob("*.db3"))).read_bytes())


SOUND: dict[str, Callable[[Path], None]] = {
    "level5.mat": mat(False),
    "compressed.mat": mat(True),
    "object.mat": mat_object,
    "level4.mat": mat_4,
    "level73.mat": mat_73,
    "plain.npz": lambda path: np.savez(path, u=U, y=Y, r=np.zeros(3, "f4,i2")),
    "compressed.npz": lambda path: np.savez_compressed(path, u=U, y=Y),
    "matrix.npy": lambda path: np.save(path, np.column_stack([U, Y])),
    "zstd.parquet": parquet(),
    "plain.parquet": parquet(compression="uncompressed"),
    "robot.mcap": mcap,
    "robot.bag": bag,
    "robot.db3": bag,
}


def edit_bytes(raw: bytes, rng: np.random.Generator) -> bytes:
    """One byte (mostly), a run of bytes, a cut, or two blocks in each other's place."""
    choice, position = rng.random(), int(rng.integers(len(raw)))
    size = int(rng.integers(1, 65))
    if choice < 0.6:
        values = [0, 1, 0x7F, 0x80, 0xFF, raw[position] ^ 1 << int(rng.integers(8)), int(rng.integers(256))]
        return raw[:position] + bytes([values[int(rng.integers(len(values)))]]) + raw[position + 1 :]
    if choice < 0.75:
        run = bytes(size) if rng.random() < 0.5 else rng.bytes(size)
        return raw[:position] + run + raw[position + size :]
    if choice < 0.85:
        return raw[:position]
    second = int(rng.integers(len(raw)))
    a, b = sorted((position, second))
    c = min(a + size, b)
    return raw[:a] + raw[b : b + c - a] + raw[c:b] + raw[a:c] + raw[b + c - a :]


class Binaries:
    """A file of another program is read, or refused in one line."""

    name = "binaries"
    seconds = 5.0

    @cached_property
    def _whole(self) -> dict[str, bytes]:
        """The sound files; polars writes some of them, whose threads would not survive a fork."""
        with tempfile.TemporaryDirectory() as folder:
            for name, write in SOUND.items():
                write(Path(folder) / name)
            return {name: (Path(folder) / name).read_bytes() for name in SOUND}

    def ready(self) -> None:
        """Modules alone, as for logs."""
        for name in ("polars", "scipy.io", "h5py", "mcap.writer", "rosbags.rosbag1", "rosbags.rosbag2"):
            importlib.import_module(name)

    def case(self, rng: np.random.Generator, folder: Path) -> str:
        """One file."""
        name = list(self._whole)[int(rng.integers(len(SOUND)))]
        path = folder / name
        path.write_bytes(edit_bytes(self._whole[name], rng))
        try:
            table = read_table(path)
            for column in table.names:
                table.numbers(column)
        except InputError as error:
            if "\n" in str(error):
                raise WrongError(f"several lines: {error}") from None
            raise
        return "read"
