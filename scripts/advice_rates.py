"""How often the advice warns of what is not there, and finds what is, by class of input.

python scripts/advice_rates.py [RECORDS] [FIRST_SEED] [SAMPLES]     drawn plants: false alarms by class, and power
python scripts/advice_rates.py --real FOLDER                         every warning on the public records of bench/real

A plant is linear, of order 1 to 4, in open loop, at rest at first; half of the records have coloured noise, 10 to 50 dB
below the output. On them "feedback", "nonlinearity" and "drift" are false alarms, "no lag" too, and a delay interval
that does not hold the true delay. "faster" is false where the plant itself needs three or more samples to 63 %,
"slower" where its resonance leaves fewer than 30 samples a period, or where it needs fewer than 60 samples. "rest" is
false on every linear plant: the input holds the output there. "sign" is that of the static gain (`sysid.diagnosis.
direction`), false where it is the other one; "no sign" is the share of records that leave a doubt.

The plants of `sysid.systems` are bent: on them a nonlinearity is there, and feedback, drift, outliers, no lag and a
wrong sign are false alarms. Their inputs are drawn: white, steps, aprbs.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

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


def drawn(name: str, seed: int, n: int) -> tuple[IOData, TransferFunction, np.ndarray]:
    """A record of a class, and its plant."""
    rng = np.random.default_rng([17, list(CLASSES).index(name), seed])
    u = CLASSES[name](n, rng)
    block, theta = plant(name, n, rng)
    y = block.output(theta, u)
    e = rng.standard_normal(n)
    if rng.random() < 0.5:
        e = lfilter([1.0], [1.0, -rng.uniform(0.5, 0.95)], e)
    return IOData(u, y + y.std() * 10 ** (-rng.uniform(10.0, 50.0) / 20) * e / e.std(), 1.0), block, theta


def judged(data: IOData, block: TransferFunction, theta: np.ndarray) -> Counter[str]:
    """What of the advice on a record of this plant is false."""
    found: Counter[str] = Counter()
    step = block.output(np.where(np.arange(len(theta)) < block.nb + block.nf, theta, 0.0), np.ones(4000))
    needs = int(np.argmax(np.abs(step) >= (1 - np.exp(-1.0)) * abs(step[-1])))
    fastest = 2 * np.pi / max(np.max(np.abs(np.angle(block.poles(theta)))), 1e-9)
    for a in advise(data):
        bad = a.severity == "warning" or (a.topic == "nonlinearity" and a.value < 0.01)
        bad = bad or (a.topic == "rest" and a.severity != "fine")
        found[a.topic] += bad and a.topic in ("feedback", "nonlinearity", "drift", "outliers", "resolution", "rest")
        if a.topic == "delay":
            found["no lag"] += bad
            low, high = getattr(a, "interval", None) or (a.value, a.value)
            found["delay missed"] += not bad and not low <= block.nk <= high
            found["delay wrong"] += not bad and a.value != block.nk
            found["delay width"] += 0 if bad else int(high - low)
        if a.topic == "rate":
            found["faster"] += "faster" in a.action and needs >= 3
            found["slower"] += "slower" in a.action and (needs < 60 or fastest < 30)
    found += signs(data, float(np.sign(step[-1])))
    return found


def signs(data: IOData, true: float) -> Counter[str]:
    """Whether the sign of the gain is left open, or is the wrong one."""
    way = direction(data)
    sure = way != 0 and confirmed(data, way)
    return Counter({"no sign": int(not sure), "sign": int(sure and way != true)})


def bent(records: int, first: int, n: int) -> None:
    """False alarms [%] on the plants of `sysid.systems` under drawn inputs."""
    columns = ["no lag", "feedback", "drift", "outliers", "sign", "no sign", "nonlinearity found"]
    print("\n| plant | " + " | ".join(columns) + " |\n| :-- |" + " --: |" * len(columns))
    inputs = [CLASSES[name] for name in ("white", "aprbs", "random steps")]
    for name in systems.TABLE:
        plant, found = systems.system(name), Counter[str]()
        for seed in range(first, first + records):
            rng = np.random.default_rng([19, seed])
            u = inputs[seed % len(inputs)](n, rng)
            u = plant.span * u / np.abs(u).max()
            x = np.ravel(plant.chain.simulate(plant.theta, u))
            data = IOData(u, x + 0.05 * x.std() * rng.standard_normal(n), plant.Ts)
            for a in advise(data):
                found[a.topic] += a.severity == "warning" and a.topic in ("feedback", "drift", "outliers")
                found["no lag"] += a.topic == "delay" and a.severity == "warning"
                found["nonlinearity found"] += a.topic == "nonlinearity" and a.severity == "note"
            ends = [
                np.ravel(plant.chain.simulate(plant.theta, np.full(3000, v)))[-1] for v in (-plant.span, plant.span)
            ]
            found += signs(data, float(np.sign(ends[1] - ends[0])))
        print(f"| {name} | " + " | ".join(f"{100 * found[c] / records:.1f}" for c in columns) + " |", flush=True)


def table(records: int, first: int, n: int) -> None:
    """False alarms [%] by class."""
    columns = ["no lag", "delay missed", "delay wrong", "delay width", "feedback", "nonlinearity", "drift"]
    columns += ["outliers", "rest", "faster", "slower", "sign", "no sign"]
    print(f"{records} records a class, seeds {first} to {first + records - 1}, {n} samples; % of records")
    print(f"(delay width: samples); 1 % has a standard error of {100 * np.sqrt(0.01 * 0.99 / records):.1f}")
    print("| input | " + " | ".join(columns) + " |\n| :-- |" + " --: |" * len(columns))
    total: Counter[str] = Counter()
    for name in CLASSES:
        found: Counter[str] = Counter()
        for seed in range(first, first + records):
            found += judged(*drawn(name, seed, n))
        total += found
        print(f"| {name} | " + " | ".join(_shown(found[c], records, c) for c in columns) + " |", flush=True)
    print("| all | " + " | ".join(_shown(total[c], records * len(CLASSES), c) for c in columns) + " |")


def _shown(count: int, records: int, column: str) -> str:
    return f"{count / records:.2f}" if column == "delay width" else f"{100 * count / records:.1f}"


def power(records: int, first: int, n: int) -> None:
    """Share [%] of records on which what is there is found: a loop, a bend, a drift; 20 dB of noise, slow and white."""
    print("\n| input | feedback (gain 0.3) | nonlinearity (cube, 5 % of y) | drift (a fifth of y) |")
    print("| :-- | --: | --: | --: |")
    for name in ("white", "aprbs", "slow", "oversampled"):
        hits: Counter[str] = Counter()
        for seed in range(first, first + records):
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
            bent = x + 0.05 * x.std() * (x / x.std()) ** 3
            for topic, data in (
                ("feedback", IOData(loop, y, 1.0)),
                ("nonlinearity", IOData(u, bent + noise, 1.0)),
                ("drift", IOData(u, x + noise + x.std() * np.linspace(0, 0.7, n), 1.0)),
            ):
                hits[topic] += any(a.topic == topic and a.severity != "fine" and a.value < 0.01 for a in advise(data))
        print(f"| {name} | " + " | ".join(f"{100 * hits[k] / records:.0f}" for k in hits) + " |", flush=True)


def real(folder: str) -> None:
    """Every warning and delay on the public records."""
    for name, (read, _) in RECORDS.items():
        task = read(Path(folder))
        records = {"train": task.train, **task.tests}
        for part, record in records.items():
            said = [a for a in advise(record) if a.severity != "fine" or a.topic == "delay"]
            print(f"{name}, {part}: {record.N} samples")
            for a in said:
                print(f"    {a.severity}: {a}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--real"]:
        real(sys.argv[2])
    else:
        numbers = [int(a) for a in sys.argv[1:]] + [100, 0, 1000][len(sys.argv) - 1 :]
        table(*numbers)
        bent(numbers[0], *numbers[1:])
        power(min(numbers[0], 40), *numbers[1:])
