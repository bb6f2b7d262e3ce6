"""A log and its twin as an MCAP file with JSON messages, which Foxglove, rerun and PlotJuggler read."""

import json
from pathlib import Path

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import whole_file
from twin.view.traces import Traces

SUFFIX = ".mcap"
SCHEMA = {
    "type": "object",
    "title": "qpal.Value",
    "properties": {"value": {"type": "number"}, "unit": {"type": "string"}},
    "required": ["value", "unit"],
}
_SECOND = 1_000_000_000  # [ns]


def write_mcap(path: Path, traces: Traces) -> Path:
    """Topics /input, /log/JOINT, /twin/JOINT and /error/JOINT, one message a sample; times count from zero.

    Raises InputError if the library `mcap` is not installed, or if the suffix is not .mcap.
    """
    if path.suffix.lower() != SUFFIX:
        raise InputError(f"{path} ends in {path.suffix or 'no suffix'!r}; give a name that ends in {SUFFIX}")
    try:
        from mcap.writer import Writer
    except ImportError:
        raise InputError("writing MCAP needs the library mcap; install it with: pip install 'qpal[robot]'") from None
    topics = {
        "/input": (traces.u, "V"),
        f"/log/{traces.joint}": (traces.log, "rad"),
        f"/twin/{traces.joint}": (traces.twin, "rad"),
        f"/error/{traces.joint}": (traces.error, "rad"),
    }
    with whole_file(path) as temporary, temporary.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="qpal")
        schema = writer.register_schema("qpal.Value", "jsonschema", json.dumps(SCHEMA).encode())
        channels = {topic: writer.register_channel(topic, "json", schema) for topic in topics}
        for k, time in enumerate(np.round(traces.t * _SECOND).astype(int).tolist()):
            for topic, (values, unit) in topics.items():
                value = float(values[k])
                if np.isfinite(value):  # JSON has no other numbers
                    message = json.dumps({"value": value, "unit": unit}).encode()
                    writer.add_message(channels[topic], log_time=time, publish_time=time, data=message, sequence=k)
        writer.finish()
    return path
