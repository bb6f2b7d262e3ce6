"""What the reader of robot logs takes out of bags of ROS 2 and MCAP files."""

import json
import sys

import numpy as np
import pytest
from few_rows import columns

from sysid.base.errors import InputError
from sysid.formats import read_table
from sysid.workflow.record import read_record

START = 1_700_000_000_123_456_789  # [ns]


def joint_states(store, k: int):
    """A message with its joints in changing order, stamped 1 ms before it was logged."""
    message, header, stamp = (
        store.types[kind]
        for kind in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    at = START + k * 10_000_000 - 1_000_000
    order = [0, 1] if k % 2 else [1, 0]
    return message(
        header=header(stamp=stamp(sec=at // 10**9, nanosec=at % 10**9), frame_id=""),
        name=[("thigh", "shank")[i] for i in order],
        position=np.array([(k * 0.5, -k * 0.25)[i] for i in order]),
        velocity=np.array([]),
        effort=np.array([]),
    )


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_bag_of_ros_2_as_folder_and_as_file(storage, tmp_path):
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[storage]) as bag:
        states = bag.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        volts = bag.add_connection("/u", "std_msgs/msg/Float64", typestore=store)
        names = bag.add_connection("/said", "std_msgs/msg/String", typestore=store)
        for k in range(8):
            at = START + k * 10_000_000
            bag.write(states, at, store.serialize_cdr(joint_states(store, k), "sensor_msgs/msg/JointState"))
            if k % 2:
                kind = store.types["std_msgs/msg/Float64"]
                bag.write(volts, at + 5, store.serialize_cdr(kind(data=k / 8), "std_msgs/msg/Float64"))
            text = store.types["std_msgs/msg/String"](data="x")
            bag.write(names, at, store.serialize_cdr(text, "std_msgs/msg/String"))
    (inner,) = (path for path in (tmp_path / "bag").iterdir() if path.suffix in (".db3", ".mcap"))
    for path in (tmp_path / "bag", inner):
        table = read_table(path)
        found = columns(table)
        assert found["joint_states.position[thigh]"] == [k * 0.5 for k in range(8)]
        assert found["joint_states.position[shank]"] == [-k * 0.25 for k in range(8)]
        assert found["joint_states.time"] == [k * 0.01 for k in range(8)]
        assert found["joint_states.header.stamp"] == [(k * 10 - 1) / 1000 for k in range(8)]
        assert found["u.data"] == [k / 8 for k in (1, 3, 5, 7)]
        np.testing.assert_allclose(found["u.time"], [k * 0.01 + 5e-9 for k in (1, 3, 5, 7)], rtol=1e-12)
        assert set(table.names) == {
            *("joint_states.time", "joint_states.position[thigh]", "joint_states.position[shank]"),
            *("joint_states.header.stamp", "u.time", "u.data"),
        }
        assert {name for name, unit in table.units.items() if unit == "s"} == {
            *("joint_states.time", "joint_states.header.stamp", "u.time"),
        }
        assert table.meta["start_ns"] == START


def test_mcap_in_json_is_kept_up_to_where_it_was_cut(tmp_path):
    writer = pytest.importorskip("mcap.writer")
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        bag = writer.Writer(file, chunk_size=256)
        bag.start()
        schema = bag.register_schema("m", "jsonschema", b"{}")
        motor, raw = bag.register_channel("/motor", "json", schema), bag.register_channel("/raw", "protobuf", schema)
        for k in range(100):
            content = {"u_V": k / 4, "on": k > 50, "name": "m", "n": {"x": [k, -k]}, "scan": [0] * 100, "time": 7}
            bag.add_message(motor, START + k * 1_000_000, json.dumps(content).encode(), 0)
        bag.add_message(raw, START, b"\1\2", 0)
        bag.finish()
    table = read_table(path)
    found = columns(table)
    assert found["motor.u_V"] == [k / 4 for k in range(100)]
    assert found["motor.n.x[1]"] == [-k for k in range(100)]
    assert found["motor.on"] == [float(k > 50) for k in range(100)]
    assert found["motor.time"] == pytest.approx([k / 1000 for k in range(100)], abs=1e-12)
    assert found["motor.message.time"] == [7.0] * 100
    assert not any("scan" in name for name in table.names)
    assert table.units == {"motor.time": "s", "motor.u_V": "V"}
    assert any("/raw (messages in protobuf)" in note for note in table.notes)
    path.write_bytes(path.read_bytes()[:9000])
    table = read_table(path)
    count = len(table.columns[0])
    assert 10 < count < 100
    assert table.numbers("motor.u_V").tolist() == [k / 4 for k in range(count)]
    assert any(f"kept the {count} messages" in note for note in table.notes)


@pytest.mark.parametrize("late", [True, False])
def test_the_even_stamp_of_the_source_is_the_clock_and_how_far_the_other_is_away_is_told(late, tmp_path):
    writer = pytest.importorskip("mcap.writer")
    jitter = np.random.default_rng(0).integers(0, 4_000_000, (2, 100))
    received, stamped = np.arange(100) * 10_000_000 + (jitter if late else 0 * jitter)
    stamped = np.arange(100) * 10_000_000 if late else stamped + jitter[1]
    path = tmp_path / "a.mcap"
    u, y = np.arange(100) // 7 % 5, np.sin(np.arange(100))
    with path.open("wb") as file:
        bag = writer.Writer(file)
        bag.start()
        motor = bag.register_channel("/motor", "json", bag.register_schema("m", "jsonschema", b"{}"))
        for k in range(100):
            content = {"stamp": (START + int(stamped[k])) / 1e9, "u": int(u[k]), "y": y[k]}
            bag.add_message(motor, START + int(received[k]), json.dumps(content).encode(), 0)
        bag.finish()
    record = read_record(path)
    assert record.time == ("motor.stamp" if late else "motor.time")
    np.testing.assert_array_equal(record.data.u[:, 0], u)
    np.testing.assert_array_equal(record.data.y[:, 0], y)
    far = np.ptp((received if late else stamped) - np.arange(100) * 10_000_000) / 1e7
    other = "motor.time" if late else "motor.stamp"
    assert any(
        f"'{other}' shows the same time, but" in note and f"({far:.0%} of a step)" in note for note in record.notes
    )


@pytest.mark.parametrize("suffix", [".mcap", ".bag", ".db3"])
def test_without_the_extra_a_sentence_says_how_to_install_it(suffix, tmp_path, monkeypatch):
    for name in ("mcap.reader", "rosbags.highlevel"):
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / f"a{suffix}").write_bytes(b"x")
    with pytest.raises(InputError, match=r"needs mcap and rosbags; install them with pip install 'qpal\[robot\]'"):
        read_table(tmp_path / f"a{suffix}")
