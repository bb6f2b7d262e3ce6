"""Damaged files of other programs: each ends in numbers or in a sentence, whatever its reader does on it.

    python scripts/fuzz_binary.py --edits 34000

Small sound files of every format are written here, then edited: a byte, a run of bytes, a cut, blocks that change
places. Each is read as users read it. Prints counts as JSON: numbers, sentence, and what must not be: traceback
(another exception), signal (the process ended), hang. `--direct` reads in the same process, as before files had one of
their own. The exit status is 1 if anything happened that must not be.
"""

import argparse
import json
import multiprocessing
import os
import struct
import sys
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

SLOW = 200.0  # [s] without an answer is a hang
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


def outcome(path: Path, direct: bool) -> str:
    """What reading the file ends in."""
    from sysid.base.errors import InputError
    from sysid.formats import TABLE, read_table

    try:
        table = TABLE[path.suffix]().read(path) if direct else read_table(path)
        for name in table.names:
            try:
                table.numbers(name)
            except InputError:
                return "sentence"
    except InputError as error:
        return "sentence" if "\n" not in str(error) else f"traceback: lines {str(error)[:200]!r}"
    except (Exception, *_panics()) as error:
        return f"traceback: {type(error).__name__}: {str(error)[:100]}"
    return "numbers"


def _panics() -> tuple[type[BaseException], ...]:
    import polars

    return (polars.exceptions.PanicException,)


def work(name: str, raw: bytes, seed: int, first: int, last: int, direct: bool, answers: int) -> None:
    """Reads the edits `first`.. of a file until `last`, or until this process ends on one."""
    if direct:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # panics are printed
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        for k in range(first, last):
            path.write_bytes(edit(name, raw, seed, k))
            os.write(answers, f"{k} {outcome(path, direct)}\n".encode())


def edit(name: str, raw: bytes, seed: int, k: int) -> bytes:
    """Edit k of a sound file, always the same."""
    return edit_bytes(raw, np.random.default_rng([seed, zlib.crc32(name.encode()), k]))


def count(name: str, raw: bytes, seed: int, edits: int, direct: bool) -> tuple[Counter, list[str]]:
    """Counts of what `edits` edits of a file end in, and the first that must not be."""
    counts: Counter = Counter()
    bad: list[str] = []
    number = 0
    context = multiprocessing.get_context("spawn")
    while number < edits:
        with tempfile.NamedTemporaryFile() as output:
            process = context.Process(target=_to_file, args=(name, raw, seed, number, edits, direct, output.name))
            process.start()
            last_progress, size = time.monotonic(), 0
            while process.is_alive() and time.monotonic() - last_progress < SLOW:
                process.join(0.05)
                if os.path.getsize(output.name) != size:
                    last_progress, size = time.monotonic(), os.path.getsize(output.name)
            hangs = process.is_alive()
            process.kill()
            process.join()
            for line in Path(output.name).read_text().splitlines():
                outcome_text = line.partition(" ")[2]
                counts[outcome_text.partition(":")[0]] += 1
                if outcome_text not in ("numbers", "sentence"):
                    bad.append(f"edit {number}: {outcome_text}")
                number += 1
        if number < edits:
            outcome_text = "hang" if hangs else "signal"
            counts[outcome_text] += 1
            bad.append(f"edit {number}: {outcome_text} {process.exitcode}")
            number += 1
    return counts, bad


def _to_file(name: str, raw: bytes, seed: int, first: int, last: int, direct: bool, answers: str) -> None:
    work(name, raw, seed, first, last, direct, os.open(answers, os.O_WRONLY | os.O_APPEND))


def main() -> int:
    """Counts of all formats, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--edits", type=int, default=34000, help="in all, shared evenly")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=list(SOUND), choices=list(SOUND), metavar="FILE")
    parser.add_argument("--direct", action="store_true", help="read in the process itself, without its protection")
    options = parser.parse_args()
    began = time.monotonic()
    every: dict[str, dict] = {}
    with tempfile.TemporaryDirectory() as folder:
        for j, name in enumerate(options.only):
            path = Path(folder) / name
            SOUND[name](path)
            edits = options.edits // len(options.only) + (j < options.edits % len(options.only))
            counts, bad = count(name, path.read_bytes(), options.seed, edits, options.direct)
            every[name] = {**counts, **({"first": bad[:3]} if bad else {})}
            print(f"{name}: {every[name]}", file=sys.stderr, flush=True)
    kinds = ("numbers", "sentence", "traceback", "signal", "hang")
    total = {kind: sum(counts_of_file.get(kind, 0) for counts_of_file in every.values()) for kind in kinds}
    seconds = round(time.monotonic() - began)
    print(json.dumps({"edits": sum(total.values()), **total, "seconds": seconds, "files": every}, indent=1))
    return int(any(total[kind] for kind in kinds[2:]))


if __name__ == "__main__":
    sys.exit(main())
