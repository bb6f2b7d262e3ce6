"""How often the advice warns of what is not there, and finds what is, by class of input.

python scripts/study.py advice_rates [--seeds 0:100] [--samples 1000]   drawn plants: false alarms by class, and power
python scripts/study.py advice_rates --real FOLDER                       every warning on the public records

A plant is linear, of order 1 to 4, in open loop, at rest at first; half of the records have coloured noise, 10 to 50 dB
below the output. On them "feedback", "nonlinearity" and "drift" are false alarms, "no lag" too, and a delay interval
that does not hold the true delay. "faster" is false where the plant itself needs three or more samples to 63 %,
"slower" where its resonance leaves fewer than 30 samples a period, or where it needs fewer than 60 samples. "rest" is
false on every linear plant: the input holds the output there. "sign" is that of the static gain (`sysid.diagnosis.
direction`), false where it is the other one; "no sign" is the share of records that leave a doubt.

The plants of `sysid.systems` are bent: on them a nonlinearity is there, and feedback, drift, outliers, no lag and a
wrong sign are false alarms. Their inputs are drawn: white, steps, aprbs.
"""

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import butter, lfilter, sosfilt
from study import Row, Study, markdown

from sysid import IOData, advise, systems
from sysid.bench.drawing.plants import draw_filter
from sysid.bench.drawing.signals import excitation
from sysid.bench.scenarios.real import RECORDS
from sysid.blocks import TransferFunction
from sysid.diagnosis.direction import confirmed, direction
from sysid.excitations import Multisine, Prbs

RESONANT = "resonant plant"
CRAWLING = "oversampled plant"


def narrow(n: int, rng: np.random.Generator) -> np.ndarray:
    """Twenty sines in one octave."""
    low = rng.uniform(0.005, 0.1)
    k = rng.uniform(low, 2 * low, 20)
    return np.asarray(np.cos(2 * np.pi * np.outer(np.arange(n), k) + rng.uniform(0, 6.28, 20)).sum(axis=1))


def band_limited(n: int, rng: np.random.Generator) -> np.ndarray:
    """A multisine without power above a twentieth to a fifth of the rate."""
    return Multisine(1.0, 1.0 / n, float(rng.uniform(0.05, 0.2)), float(n), phases="random").generate(n, 1.0, rng)


def slow(n: int, rng: np.random.Generator) -> np.ndarray:
    """Noise behind one pole of 50 samples."""
    return np.asarray(lfilter([1.0], [1.0, -0.98], rng.standard_normal(n)))


def smooth(n: int, rng: np.random.Generator) -> np.ndarray:
    """Oversampled: noise behind a fourth-order low-pass at 2 to 5 % of the rate."""
    sos = butter(4, rng.uniform(0.02, 0.05), fs=1.0, output="sos")
    return np.asarray(sosfilt(sos, rng.standard_normal(n + 500))[500:])


def chirp(n: int, rng: np.random.Generator) -> np.ndarray:
    """A sine whose frequency rises from 0.2 to 20 % of the rate."""
    t = np.arange(n) / n
    return np.asarray(np.sin(2 * np.pi * n * (0.002 * t + 0.5 * (rng.uniform(0.05, 0.2) - 0.002) * t**2)))


CLASSES = {
    "white": lambda n, rng: rng.standard_normal(n),
    "binary": lambda n, rng: Prbs(1.0, 10, float(rng.integers(1, 8))).generate(n, 1.0, rng),
    "aprbs": lambda n, rng: excitation("aprbs", n, rng),
    "random steps": lambda n, rng: excitation("random steps", n, rng),
    "narrow band": narrow,
    "band-limited": band_limited,
    "slow": slow,
    "oversampled": smooth,
    "chirp": chirp,
    RESONANT: lambda n, rng: excitation("aprbs", n, rng),
    CRAWLING: lambda n, rng: excitation("aprbs", n, rng),
}


def plant(name: str, n: int, rng: np.random.Generator) -> tuple[TransferFunction, np.ndarray]:
    """The plant of a class."""
    if name not in (RESONANT, CRAWLING):
        return draw_filter(rng, n, int(rng.integers(1, 5)), "linear")[:2]
    delay = int(rng.integers(0, 5))
    if name == RESONANT:
        z = (1.0 - rng.uniform(0.005, 0.05)) * np.exp(2j * np.pi / rng.uniform(6.0, 60.0) * np.array([1, -1]))
    else:
        z = np.exp(-1.0 / rng.uniform(40.0, 100.0, 2))
    block = TransferFunction(2, 2, delay, role="linear")
    f = np.real(np.poly(z))[1:]
    return block, np.concatenate([(1.0 + f.sum()) * np.array([0.7, 0.3]), f, np.zeros(block.n_state)])


def draw_record(name: str, seed: int, n: int) -> tuple[IOData, TransferFunction, np.ndarray]:
    """A record of a class, and its plant."""
    rng = np.random.default_rng([17, list(CLASSES).index(name), seed])
    u = CLASSES[name](n, rng)
    block, theta = plant(name, n, rng)
    y = block.output(theta, u)
    e = rng.standard_normal(n)
    if rng.random() < 0.5:
        e = lfilter([1.0], [1.0, -rng.uniform(0.5, 0.95)], e)
    return IOData(u, y + y.std() * 10 ** (-rng.uniform(10.0, 50.0) / 20) * e / e.std(), 1.0), block, theta


def judge_linear(data: IOData, block: TransferFunction, theta: np.ndarray) -> Counter[str]:
    """What of the advice on a record of this plant is false."""
    counts: Counter[str] = Counter()
    step = block.output(np.where(np.arange(len(theta)) < block.nb + block.nf, theta, 0.0), np.ones(4000))
    needs = int(np.argmax(np.abs(step) >= (1 - np.exp(-1.0)) * abs(step[-1])))
    fastest = 2 * np.pi / max(np.max(np.abs(np.angle(block.poles(theta)))), 1e-9)
    for a in advise(data):
        bad = a.severity == "warning" or (a.topic == "nonlinearity" and a.value < 0.01)
        bad = bad or (a.topic == "rest" and a.severity != "fine")
        counts[a.topic] += bad and a.topic in ("feedback", "nonlinearity", "drift", "outliers", "resolution", "rest")
        if a.topic == "delay":
            counts["no lag"] += bad
            low, high = getattr(a, "interval", None) or (a.value, a.value)
            counts["delay missed"] += not bad and not low <= block.nk <= high
            counts["delay wrong"] += not bad and a.value != block.nk
            counts["delay width"] += 0 if bad else int(high - low)
        if a.topic == "rate":
            counts["faster"] += "faster" in a.action and needs >= 3
            counts["slower"] += "slower" in a.action and (needs < 60 or fastest < 30)
    counts += signs(data, float(np.sign(step[-1])))
    return counts


def signs(data: IOData, true: float) -> Counter[str]:
    """Whether the sign of the gain is left open, or is the wrong one."""
    way = direction(data)
    sure = way != 0 and confirmed(data, way)
    return Counter({"no sign": int(not sure), "sign": int(sure and way != true)})


def judge_system(name: str, seed: int, n: int) -> Counter[str]:
    """What of the advice on a plant of `sysid.systems` under a drawn input is false."""
    plant, counts = systems.system(name), Counter[str]()
    inputs = [CLASSES[kind] for kind in ("white", "aprbs", "random steps")]
    rng = np.random.default_rng([19, seed])
    u = inputs[seed % len(inputs)](n, rng)
    u = plant.span * u / np.abs(u).max()
    x = np.ravel(plant.chain.simulate(plant.theta, u))
    for a in advise(data := IOData(u, x + 0.05 * x.std() * rng.standard_normal(n), plant.Ts)):
        counts[a.topic] += a.severity == "warning" and a.topic in ("feedback", "drift", "outliers")
        counts["no lag"] += a.topic == "delay" and a.severity == "warning"
        counts["nonlinearity found"] += a.topic == "nonlinearity" and a.severity == "note"
    ends = [np.ravel(plant.chain.simulate(plant.theta, np.full(3000, v)))[-1] for v in (-plant.span, plant.span)]
    return counts + signs(data, float(np.sign(ends[1] - ends[0])))


def present(name: str, seed: int, n: int) -> Counter[str]:
    """What is there and is found: a loop, a bend, a drift; 20 dB of noise, slow and white."""
    hits: Counter[str] = Counter()
    rng = np.random.default_rng([18, seed])
    u = CLASSES[name](n, rng)
    u = u / u.std()
    x = lfilter([0, 0.5, 0.2], [1, -1.5, 0.7], u)
    v = lfilter([0.3], [1, -0.9], rng.standard_normal(n)) * x.std()
    loop, y = np.zeros(n), np.zeros(n)
    s = np.zeros(n + 2)
    for t in range(n):
        s[t] = 1.5 * s[t - 1] - 0.7 * s[t - 2] + (0.5 * loop[t - 1] + 0.2 * loop[t - 2] if t > 1 else 0.0)
        y[t] = s[t] + 0.3 * v[t]
        loop[t] = u[t] - 0.12 * y[t]
    noise = 0.1 * x.std() * rng.standard_normal(n)
    curved = x + 0.05 * x.std() * (x / x.std()) ** 3
    for topic, data in (
        ("feedback", IOData(loop, y, 1.0)),
        ("nonlinearity", IOData(u, curved + noise, 1.0)),
        ("drift", IOData(u, x + noise + x.std() * np.linspace(0, 0.7, n), 1.0)),
    ):
        hits[topic] += any(a.topic == topic and a.severity != "fine" and a.value < 0.01 for a in advise(data))
    return hits


def advice_on_record(name: str, part: str, folder: str) -> list[str]:
    """Every warning and delay on a public record, after its length."""
    task = RECORDS[name][0](Path(folder))
    record = {"train": task.train, **task.tests}[part]
    texts = [f"    {a.severity}: {a}" for a in advise(record) if a.severity != "fine" or a.topic == "delay"]
    return [f"{name}, {part}: {record.N} samples", *texts]


# Tables: their kind of case, heading of the first column, rows, and columns with the count that each shows.
FALSE = ["no lag", "delay missed", "delay wrong", "delay width", "feedback", "nonlinearity", "drift"]
FALSE += ["outliers", "rest", "faster", "slower", "sign", "no sign"]
BENT = ["no lag", "feedback", "drift", "outliers", "sign", "no sign", "nonlinearity found"]
POWER = {
    "feedback (gain 0.3)": "feedback",
    "nonlinearity (cube, 5 % of y)": "nonlinearity",
    "drift (a fifth of y)": "drift",
}
POWER_CLASSES = ("white", "aprbs", "slow", "oversampled")
MOST = 40  # seeds of a row of the table of power


def cases(options: argparse.Namespace) -> list[tuple[str, str, Any]]:
    """Kind of table, its row, and a seed; or the parts of the public records."""
    if options.real is not None:
        tasks = {name: read(Path(options.real)) for name, (read, _) in RECORDS.items()}
        return [("real", name, part) for name, task in tasks.items() for part in ("train", *task.tests)]
    rows = [("false", name, seed) for name in CLASSES for seed in options.seeds]
    rows += [("bent", name, seed) for name in systems.TABLE for seed in options.seeds]
    return rows + [("power", name, seed) for name in POWER_CLASSES for seed in options.seeds[:MOST]]


def score(case: tuple[str, str, Any], options: argparse.Namespace) -> Row:
    """The counts of one record, or the advice on a public one."""
    kind, name, key = case
    if kind == "real":
        return {"lines": advice_on_record(name, key, options.real)}
    if kind == "false":
        return {"counts": judge_linear(*draw_record(name, key, options.samples))}
    return {"counts": (judge_system if kind == "bent" else present)(name, key, options.samples)}


def summary(rows: list[Row], options: argparse.Namespace) -> str:
    """False alarms [%] by class and on bent plants, and the power; or the advice on public records."""
    if options.real is not None:
        return "\n".join(text for row in rows for text in row["lines"])
    counts: dict[tuple[str, str], list[dict[str, int]]] = {}
    for row in rows:
        kind, name, _ = row["case"]
        for key in ((kind, name), (kind, "all")) if kind == "false" else ((kind, name),):
            counts.setdefault(key, []).append(row["counts"])
    n = len(options.seeds)
    text = (
        f"{n} records a class, seeds {options.seeds[0]} to {options.seeds[-1]}, {options.samples} samples; % of records"
    )
    text += f"\n(delay width: samples); 1 % has a standard error of {100 * np.sqrt(0.01 * 0.99 / n):.1f}"
    tables = [("false", "input", [*CLASSES, "all"], {c: c for c in FALSE})]
    tables += [("bent", "plant", list(systems.TABLE), {c: c for c in BENT}), ("power", "input", POWER_CLASSES, POWER)]
    texts = []
    for kind, heading, names, columns in tables:
        cells = [[name, *(_cell(counts[kind, name], c, kind) for c in columns.values())] for name in names]
        texts.append(markdown([heading, *columns], cells))
    return text + "\n" + "\n\n".join(texts)


def _cell(counts: list[dict[str, int]], column: str, kind: str) -> str:
    mean = sum(count.get(column, 0) for count in counts) / len(counts)
    return f"{mean:.2f}" if column == "delay width" else f"{100 * mean:.0f}" if kind == "power" else f"{100 * mean:.1f}"


STUDY = Study(
    cases,
    score,
    summary,
    seeds="0:100",
    options={
        "--samples": {"type": int, "default": 1000},
        "--real": {"metavar": "FOLDER", "help": "every warning on the public records of `qpal bench` instead"},
    },
)
