"""Experiments whose rows take turns, restarts after few rows, sampling times of parts, newest rows first."""

import json

import numpy as np

from corpus._log import ROWS, TS, Log, Right, T, U, Y, log, refused
from corpus.binaries import mat

TWICE = Right(U + U, Y + Y)
PARTS = [{"Ts": TS, "u": list(U), "y": list(Y)}] * 2
TURNS = [f"{name},{row}" for row in ROWS.split() for name in (1, 2)]
LONG = [f"{t:.1f},{key},{x:g}" for t, u, y in zip(T, U, Y, strict=True) for key, x in (("u", u), ("y", y))]


def lines(head: str, rows: list[str]) -> str:
    """A text table."""
    return "\n".join([head, *rows, ""])


def structs(**more: float) -> bytes:
    """A struct array of two experiments, each with its sampling time."""
    array = np.zeros(2, dtype=[(name, object) for name in ("Ts", "u", "y")])
    for k in range(2):
        array[k] = (TS, np.array(U), np.array(Y))
    return mat(test=array, **more)


OVER_MIDNIGHT = [f"23:59:{59.5 + t:04.1f}" if t < 0.5 else f"00:00:{t - 0.5:04.1f}" for t in T]

LATER = [f"{t + 0.6:.1f},{u:g},{y:g}" for t, u, y in zip(T, U, Y, strict=True)]
PAUSED = [f"{t + 60:.1f},{u:g},{y:g}" for t, u, y in zip(T, U, Y, strict=True)]
MOTORS = [f"{t + 0.01 * k:.2f},{k},{u:g},{y:g}" for t, u, y in zip(T, U, Y, strict=True) for k in (1, 2)]
SIGNALS = [{"name": name, "time": list(T), "values": list(x)} for name, x in (("u", U), ("y", Y))]
FIELDS = [f"{t:.1f},/{key},data,{x:g}" for t, u, y in zip(T, U, Y, strict=True) for key, x in (("cmd", u), ("enc", y))]
ENTITIES = [
    f"{name},{x:g},2026-03-01T12:00:{2 * k:02d}.000Z"
    for name, values in (("number.valve", U), ("sensor.temp", Y))
    for k, x in enumerate(values)
]
VALUES = list(zip(T, U, Y, strict=True))
TAGS = [
    f"FIC1.{tag};{t:.1f};{x:g};{192 - k % 2}" for k, (t, u, y) in enumerate(VALUES) for tag, x in (("OP", u), ("PV", y))
]
INFLUX = [  # annotated CSV of InfluxDB: a block for each series, which column "table" numbers
    f",,{k},{name},rig,2026-03-14T09:00:{2 * i:02d}Z,{x:g}"
    for k, (name, values) in enumerate((("valve", U), ("temp", Y)))
    for i, x in enumerate(values)
]
HEAD = ",result,table,_field,_measurement,_time,_value"
DATED = [f"2026-03-14 09:00:{2 * k:02d}" for k in range(len(T))]
ANNOTATED = "#group,false,false,true,true,false,false\n#datatype,string,long,string,string,dateTime:RFC3339,double\n"
MESSAGES = [  # MQTT, logged as JSON lines
    {"t": t, "topic": f"rig/{key}", "payload": {key: x}} for t, u, y in VALUES for key, x in (("u", u), ("y", y))
]
ALIKE = [{**each, "payload": {"value": x}} for each in MESSAGES for x in each["payload"].values()]
STEPS = [f"{k},{u:g},{y:g}" for k, (u, y) in enumerate(zip(U, Y, strict=True))]

LOGS: dict[str, Log] = {
    "a second run that starts later than the first": log(lines("t,u,y", ROWS.split() + LATER), TWICE),
    "a second run that starts later, the sampling time given": log(lines("t,u,y", ROWS.split() + LATER), TWICE, Ts=TS),
    "a second run behind a pause longer than the runs": log(lines("t,u,y", ROWS.split() + PAUSED), TWICE),
    "a second run behind a pause, the sampling time given": log(lines("t,u,y", ROWS.split() + PAUSED), TWICE, Ts=TS),
    "two motors in turns, a hundredth of a second apart": log(lines("t,motor,u,y", MOTORS), TWICE),
    "two motors in turns, the sampling time given": log(lines("t,motor,u,y", MOTORS), TWICE, Ts=TS),
    "signals by name in JSON": log(json.dumps(SIGNALS), file="a.json"),
    "signals by name in an object in JSON": log(json.dumps({"rig": "A", "signals": SIGNALS}), file="a.json"),
    "signals by name without stamps in JSON": log(
        json.dumps([{"name": each["name"], "values": each["values"]} for each in SIGNALS]), file="a.json", Ts=TS
    ),
    "signals by name with samples in JSON": log(
        json.dumps(
            [
                {"signal": name, "data": [{"t": t, "v": v} for t, v in zip(T, x, strict=True)]}
                for name, x in (("u", U), ("y", Y))
            ]
        ),
        file="a.json",
    ),
    "long table with a column of runs": log(
        lines("run,time,name,value", [f"{run},{row}" for run in (1, 2) for row in LONG]), TWICE
    ),
    "long table with a column of runs in words": log(
        lines("trial,time,name,value", [f"{run},{row}" for run in ("slow", "fast") for row in LONG]), TWICE
    ),
    "long table with topics and fields": log(lines("timestamp,topic,field,value", FIELDS), input="/cmd", output="/enc"),
    "long table with two fields of two topics": log(
        lines(
            "timestamp,topic,field,value",
            [
                f"{t:.1f},/m{k},{field},{x + k - 1:g}"
                for t, u, y in zip(T, U, Y, strict=True)
                for k in (1, 2)
                for field, x in (("u", u), ("y", y))
            ],
        ),
        input="/m1.u",
        output="/m1.y",
    ),
    "history of Home Assistant": log(
        lines("entity_id,state,last_changed", ENTITIES), Right(Ts=2.0), input="number.valve", output="sensor.temp"
    ),
    "tags of a controller with their quality": log(
        lines("TagName;Timestamp_s;Value;Quality", TAGS), input="FIC1.OP", output="FIC1.PV", time="Timestamp_s"
    ),
    "annotated series of InfluxDB": log(
        ANNOTATED + lines(HEAD, INFLUX),
        Right(Ts=2.0),
        input="valve",
        output="temp",
    ),
    "series of InfluxDB of two types, with a header each": log(
        ANNOTATED + lines(HEAD, INFLUX[:12]) + "\n" + ANNOTATED + lines(HEAD, INFLUX[12:]),
        Right(Ts=2.0),
        input="valve",
        output="temp",
    ),
    "series of InfluxDB of two machines": log(
        ANNOTATED + lines(HEAD + ",host", [f"{row},{k}" for row in INFLUX for k in ("A", "B")]),
        Right(Ts=2.0),
        input="valve.A",
        output="temp.A",
    ),
    "a table of names and values called otherwise": log(
        lines(
            "VarName,TimeString,VarValue,Validity",
            [f"{row.split(',')[1]},{DATED[k // 2]},{row.split(',')[2]},1" for k, row in enumerate(LONG)],
        ),
        Right(Ts=2.0),
    ),
    "messages with a number as payload": log(
        lines(
            "",
            [
                json.dumps({"time": m["t"], "topic": m["topic"], "payload": x})
                for m in MESSAGES
                for x in m["payload"].values()
            ],
        ),
        file="a.jsonl",
        input="rig/u",
        output="rig/y",
    ),
    "milliseconds called ts": log(lines("ts,u,y", [f"{1000 * t:.0f},{u:g},{y:g}" for t, u, y in VALUES])),
    "a log of a controller": log(
        lines("time,Setpoint,Input,Output", [f"{t:.1f},{k % 3},{y:g},{u:g}" for k, (t, u, y) in enumerate(VALUES)]),
        refused("--input"),
    ),
    "a switch in words beside one signal": log(
        lines("t,heater,y", [f"{t:.1f},{'ON' if u > 0 else 'OFF'},{y:g}" for t, u, y in VALUES]),
        Right(u=tuple(float(u > 0) for u in U)),
        input="heater",
        output="y",
    ),
    "messages in JSON lines, a key for each topic": log(lines("", [json.dumps(m) for m in MESSAGES]), file="a.jsonl"),
    "messages in JSON lines, one key for all topics": log(
        lines("", [json.dumps(m) for m in ALIKE]), file="a.jsonl", input="rig/u", output="rig/y"
    ),
    "a sensor beside data, no table of names": log(
        lines("t,imu.sensor,cmd.data", [f"{t:.1f},{y:g},{u:g}" for t, u, y in VALUES]),
        input="cmd.data",
        output="imu.sensor",
    ),
    "more runs than steps, the steps numbered": log(lines("step,u,y", STEPS * 13), Right(U * 13, Y * 13), Ts=TS),
    "runs that take turns": log(lines("run,t,u,y", TURNS), TWICE),
    "trials that take turns, a name for each": log(
        lines(
            "trial,t,u,y", [row.replace("1,", "A,", 1) if k % 2 == 0 else f"B{row[1:]}" for k, row in enumerate(TURNS)]
        ),
        TWICE,
    ),
    "runs that take turns, each with a clock of its own": log(
        lines(
            "t,run,u,y", [f"{t + 50 * k:.1f},{k},{u:g},{y:g}" for t, u, y in zip(T, U, Y, strict=True) for k in (1, 2)]
        ),
        TWICE,
    ),
    "runs that take turns, the sampling time given": log(lines("run,t,u,y", TURNS), TWICE, Ts=TS),
    "runs that take turns, newest first": log(lines("run,t,u,y", TURNS[::-1]), TWICE),
    "a restart after four rows": log(lines("t,u,y", ROWS.split()[:4] + ROWS.split())),
    "a restart after four rows, the sampling time given": log(lines("t,u,y", ROWS.split()[:4] + ROWS.split()), Ts=TS),
    "a restart before the last five rows, the sampling time given": log(
        lines("t,u,y", ROWS.split() + ROWS.split()[:5]), Ts=TS
    ),
    "two restarts after few rows, the sampling time given": log(
        lines("t,u,y", ROWS.split()[:5] + ROWS.split()[:7] + ROWS.split()), Ts=TS
    ),
    "tests with their sampling time": log(json.dumps(PARTS), TWICE, file="a.json"),
    "tests with their sampling time within an object": log(
        json.dumps({"rig": "A", "tests": PARTS}), TWICE, file="a.json"
    ),
    "tests with their sampling time, one a line": log("\n".join(map(json.dumps, PARTS)), TWICE, file="a.jsonl"),
    "structs with their sampling time": log(structs(), TWICE, file="a.mat"),
    "one struct with its sampling time": log(mat(data={"Ts": TS, "u": U, "y": Y}), file="a.mat"),
    "long table, newest first": log(lines("time,key,value", LONG[::-1])),
    "long table, newest first, names in order": log(
        lines("time,key,value", [LONG[2 * k + j] for k in range(11, -1, -1) for j in (0, 1)])
    ),
    "long table of dates, newest first": log(
        lines("_time,_field,_value", [f"2026-03-01T12:00:0{row.replace(',', 'Z,', 1)}" for row in LONG[::-1]])
    ),
    "times of day over midnight, newest first": log(
        lines("time,u,y", [f"{t},{u:g},{y:g}" for t, u, y in zip(OVER_MIDNIGHT, U, Y, strict=True)][::-1])
    ),
    "times of day over midnight beside the date, newest first": log(
        lines(
            "date,time,u,y",
            [
                f"2026-03-{1 + t.startswith('00'):02d},{t},{u:g},{y:g}"
                for t, u, y in zip(OVER_MIDNIGHT, U, Y, strict=True)
            ][::-1],
        )
    ),
    "times of day with PM and AM over midnight, newest first": log(
        lines(
            "time,u,y",
            [
                f"{t.replace('23:', '11:').replace('00:', '12:', 1)} {'PM' if t.startswith('23') else 'AM'},{u:g},{y:g}"
                for t, u, y in zip(OVER_MIDNIGHT, U, Y, strict=True)
            ][::-1],
        )
    ),
}
