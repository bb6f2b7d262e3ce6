"""What the readers of MATLAB files take out: structs, cells, structures with time, both formats."""

import h5py
import numpy as np
import scipy.io
from few_rows import T, U, columns
from mat_bytes import level_5, vector

from sysid.formats import read_table


def structs(*entries: dict) -> np.ndarray:
    """A MATLAB struct array 1xn."""
    found = np.empty((1, len(entries)), dtype=[(name, object) for name in entries[0]])
    for k, entry in enumerate(entries):
        found[0, k] = tuple(entry.values())
    return found


def test_matlab_5_structs_cells_and_structure_with_time(tmp_path):
    pair = np.column_stack([U, -U])
    signals = structs({"values": U[:, None], "label": "pos_deg"}, {"values": pair, "label": ""})
    content = {
        "s": {"u": U, "about": {"k": 3.0, "by": "me"}},
        "log": {"time": T[:, None], "signals": signals, "blockName": "model/To Workspace"},
        "one": {"time": T[:, None], "signals": {"values": pair.T.reshape(1, 2, 6), "label": "q", "dimensions": 2.0}},
        "wide": {"time": T[:, None], "signals": {"values": np.arange(48.0).reshape(1, 8, 6), "label": ""}},
        "points": structs({"t": 0.5, "x": U}, {"t": 1.5, "x": -U}),
        "c": np.array([U, "text"], dtype=object),
        "on": U > 0,
    }
    scipy.io.savemat(tmp_path / "a.mat", content)
    table = read_table(tmp_path / "a.mat")
    u, t = U.tolist(), T.tolist()
    assert columns(table) == {
        **{"s.u": u, "log.time": t, "log.pos_deg": u, "log.signals(2):1": u, "log.signals(2):2": (-U).tolist()},
        **{"one.time": t, "one.q:1": u, "one.q:2": (-U).tolist()},
        "wide.time": t,
        **{f"wide.signals:{j + 1}": list(range(6 * j, 6 * j + 6)) for j in range(8)},  # more signals than samples
        **{"points.t": [0.5, 1.5], "points(1).x": u, "points(2).x": (-U).tolist(), "c{1}": u},
        "on": (U > 0).astype(float).tolist(),
    }
    assert table.units == {"log.time": "s", "one.time": "s", "wide.time": "s", "log.pos_deg": "deg"}
    assert table.meta == {"s.about.k": 3.0, "s.about.by": "me", "c{2}": "text"}


def test_matlab_5_of_either_byte_order_and_compressed(tmp_path):
    scipy.io.savemat(
        tmp_path / "a.mat", {"u": U, "S": scipy.sparse.csc_array(np.diag(U)), "z": "x"}, do_compression=True
    )
    assert read_table(tmp_path / "a.mat").numbers("u").tolist() == U.tolist()
    (tmp_path / "b.mat").write_bytes(level_5(vector(b"u", U)))
    assert read_table(tmp_path / "b.mat").numbers("u").tolist() == U.tolist()
    scipy.io.savemat(tmp_path / "c.mat", {"u": U}, format="4")
    assert read_table(tmp_path / "c.mat").numbers("u").tolist() == U.tolist()


def matlab_73(path, build) -> None:
    """A file of version 7.3 as MATLAB lays it out: a text block in front, classes as attributes, axes reversed."""
    with h5py.File(path, "w", userblock_size=512) as file:
        build(file)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: PCWIN64".ljust(124) + bytes([0, 2]) + b"IM")


def put(group, name: str, values: np.ndarray, kind: str = "double"):
    node = group.create_dataset(name, data=values)
    node.attrs["MATLAB_class"] = np.bytes_(kind)
    return node


def struct_in(group, name: str):
    node = group.create_group(name)
    node.attrs["MATLAB_class"] = np.bytes_("struct")
    return node


def letters(text: str) -> np.ndarray:
    return np.array([[ord(letter)] for letter in text], dtype=np.uint16)


def test_matlab_73(tmp_path):
    def build(file):
        refs = file.create_group("#refs#")
        put(file, "u", U[None, :])  # 6x1 in MATLAB
        put(file, "M", np.stack([T, U]))  # 6x2 in MATLAB
        put(file, "gain", np.array([[2.5]]))
        put(file, "name", letters("leg"), "char")
        put(file, "empty", np.array([0, 0], dtype=np.uint64)).attrs["MATLAB_empty"] = np.uint8(1)
        s = struct_in(file, "s")
        put(s, "t_ms", T[None, :] * 1000)
        put(struct_in(s, "deep"), "y", -U[None, :])
        log = struct_in(file, "log")
        put(log, "time", T[None, :])
        signals = struct_in(log, "signals")  # an array 1x2 of structs: each field a list of references
        kept = {"values": (U[None, :], -U[None, :]), "label": (letters("pos"), letters("vel"))}
        for field, pair in kept.items():
            made = [
                put(refs, f"{field}{k}", each, "char" if field == "label" else "double") for k, each in enumerate(pair)
            ]
            signals.create_dataset(field, data=np.array([[node.ref] for node in made], dtype=h5py.ref_dtype))
        wide = struct_in(file, "wide")
        put(wide, "time", T[None, :])
        put(struct_in(wide, "signals"), "values", np.arange(48.0).reshape(8, 6))  # 6x8 in MATLAB
        cell = file.create_dataset("c", data=np.array([[refs["values0"].ref]], dtype=h5py.ref_dtype))
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        ts = put(file, "ts", np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype=np.uint32), "timeseries")
        ts.attrs["MATLAB_object_decode"] = np.int32(3)

    matlab_73(tmp_path / "a.mat", build)
    table = read_table(tmp_path / "a.mat")
    u, t = U.tolist(), T.tolist()
    assert columns(table) == {
        **{"u": u, "M:1": t, "M:2": u, "s.t_ms": (T * 1000).tolist(), "s.deep.y": (-U).tolist()},
        **{"log.time": t, "log.pos": u, "log.vel": (-U).tolist(), "c{1}": u},
        "wide.time": t,
        **{f"wide.signals:{j + 1}": list(range(6 * j, 6 * j + 6)) for j in range(8)},
    }
    assert table.meta == {"gain": 2.5, "name": "leg"}
    assert table.units == {"s.t_ms": "ms", "log.time": "s", "wide.time": "s"}
    assert any("ts (timeseries object)" in note and "t = ts.Time; y = ts.Data" in note for note in table.notes)
