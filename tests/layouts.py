"""A true record, and the ways in which a rig may have written it: names, units, order, clock, decimal marks, faults."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

CLOCKS = {  # name of the column: unit, and whether the name says it
    "time_s": ("s", True),
    "t": (None, False),
    "time": (None, False),
    "timestamp": (None, False),
    "t [ms]": ("ms", True),
    "time (s)": ("s", True),
    "Time [us]": ("us", True),
    "t_ms": ("ms", True),
    "millis": ("ms", True),
    "micros": ("us", True),
    "elapsed/s": ("s", True),
    "a": (None, False),
}
FACTORS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
INPUTS = {  # name of the column: V in one of its numbers, None if the name does not say
    "u": None,
    "u_V": 1.0,
    "voltage [mV]": 1e-3,
    "motor_voltage (V)": 1.0,
    "pwm": None,
    "cmd": None,
    "input": None,
    "b": None,
    "ch1 [V]": 1.0,
}
OUTPUTS = {  # name of the column: rad in one of its numbers
    "y": None,
    "angle_rad": 1.0,
    "angle (deg)": np.pi / 180.0,
    "Position [°]": np.pi / 180.0,
    "theta [rev]": 2.0 * np.pi,
    "pos/mrad": 1e-3,
    "q": None,
    "potentiometer": None,
    "c": None,
    "link [deg]": np.pi / 180.0,
    "pot_voltage": None,
}
OTHERS = ("temp", "supply_V", "speed_rad_s", "current [A]", "index", "enable", "angle_true_rad", "error")
STEPS = (0.0005, 0.001, 0.002, 0.004, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5, 1.0, 2.0)


@dataclass(frozen=True)
class Layout:
    """How the true record stands in the file."""

    seed: int
    Ts: float
    N: int
    clock: str | None
    clock_unit: str
    start: float
    wrap: int
    input: str
    output: str
    others: tuple[str, ...]
    order: int
    separator: str
    decimal: str
    header: bool
    bom: bool
    lost: int
    repeated: int
    jitter: float
    decimals: int
    time_digits: int = 6


def layouts() -> st.SearchStrategy[Layout]:
    """Every layout; most have no fault in their stamps, as most logs."""
    rarely = st.sampled_from([0, 0, 0, 1, 2])
    return st.builds(
        Layout,
        seed=st.integers(0, 10**6),
        Ts=st.sampled_from(STEPS),
        N=st.integers(80, 400),
        clock=st.sampled_from([*CLOCKS, None]),
        clock_unit=st.sampled_from(list(FACTORS)),
        start=st.sampled_from([0.0, 0.0, 3.7, 61.0, 4290.0]),
        wrap=st.sampled_from([0, 0, 16, 32]),
        input=st.sampled_from(list(INPUTS)),
        output=st.sampled_from(list(OUTPUTS)),
        others=st.lists(st.sampled_from(OTHERS), max_size=2, unique=True).map(tuple),
        order=st.integers(0, 10**6),
        separator=st.sampled_from([",", ";", "\t"]),
        decimal=st.sampled_from([".", ".", ","]),
        header=st.sampled_from([True, True, True, False]),
        bom=st.booleans(),
        lost=rarely,
        repeated=rarely,
        jitter=st.sampled_from([0.0, 0.0, 0.0, 0.004, 0.2]),
        decimals=st.integers(5, 9),
    )


@dataclass(frozen=True)
class Truth:
    """The rig: u(t) [V] changes at random times, y(t) [rad] is smooth; both can be asked at any time [s]."""

    Ts: float
    levels: np.ndarray
    hold: float
    waves: np.ndarray

    @staticmethod
    def draw(rng: np.random.Generator, Ts: float, N: int) -> "Truth":
        """Levels are held for seven to eight and a half samples; the fastest wave has forty samples a period."""
        levels = np.round(rng.uniform(-12, 12, N), 2)
        period = Ts * rng.uniform(40, 200, 3)
        return Truth(Ts, levels, 7.3 * Ts, np.column_stack([rng.uniform(0.1, 0.5, 3), 2 * np.pi / period]))

    def u(self, t: np.ndarray) -> np.ndarray:
        """Voltage (n,) at t (n,) [s] from the start of the record."""
        return self.levels[np.floor(np.maximum(t, 0) / self.hold + 1e-9).astype(int)]

    def y(self, t: np.ndarray) -> np.ndarray:
        """Angle (n,) at t (n,) [s]."""
        return sum(a * np.sin(w * t + k) for k, (a, w) in enumerate(self.waves))

    @property
    def curvature(self) -> float:
        """Largest second derivative of y [rad/s^2]."""
        return float(np.sum(self.waves[:, 0] * self.waves[:, 1] ** 2))


@dataclass(frozen=True)
class Written:
    """The file, its truth, the true times (n,) [s] of its rows, and the columns as they stand in it."""

    path: Path
    truth: Truth
    t: np.ndarray
    stamps: np.ndarray | None
    unit: str
    u_factor: float | None
    y_factor: float | None
    numbers: dict[str, np.ndarray]


def write(layout: Layout, folder: Path) -> Written:
    """The record in the file that the layout describes."""
    rng = np.random.default_rng(layout.seed)
    truth = Truth.draw(rng, layout.Ts, layout.N)
    t = layout.Ts * np.arange(layout.N)
    if layout.clock is not None:
        t = t + layout.jitter * layout.Ts * rng.uniform(-1, 1, layout.N) * (layout.N > 1)
        t[0] = 0.0
        lost = rng.choice(np.arange(5, layout.N - 5), layout.lost, replace=False)
        t = np.delete(t, lost)
        for k in rng.choice(np.arange(5, len(t) - 5), layout.repeated, replace=False):
            t = np.insert(t, k, t[k])
    columns, stamps, unit = {}, None, "s"
    if layout.clock is not None:
        unit = CLOCKS[layout.clock][0] or layout.clock_unit
        stamps = (layout.start + t) / FACTORS[unit]
        counter = unit != "s" and (layout.wrap or layout.clock in ("millis", "micros"))
        if counter:
            stamps = np.floor(stamps + 1e-6)
            stamps = np.mod(stamps, 2.0**layout.wrap) if layout.wrap else stamps
        else:
            stamps = np.round(stamps, layout.time_digits)
        columns[layout.clock] = stamps
    u_factor, y_factor = INPUTS[layout.input], OUTPUTS[layout.output]
    columns[layout.input] = np.round(truth.u(t) / (u_factor or 1.0), layout.decimals)
    columns[layout.output] = np.round(truth.y(t) / (y_factor or 1.0), layout.decimals)
    for name in layout.others:
        columns[name] = _other(name, t, truth, rng)
    names = list(columns)
    np.random.default_rng(layout.order).shuffle(names)
    decimal = layout.decimal if layout.separator != "," else "."
    cells = [[f"{value:.9f}".rstrip("0").rstrip(".") for value in columns[name]] for name in names]
    rows = [layout.separator.join(row).replace(".", decimal) for row in zip(*cells, strict=True)]
    text = "\n".join([*([layout.separator.join(names)] if layout.header else []), *rows]) + "\n"
    path = folder / "rig.csv"
    path.write_text(("\ufeff" if layout.bom else "") + text, encoding="utf-8")
    return Written(path, truth, t, stamps, unit, u_factor, y_factor, columns)


def _other(name: str, t: np.ndarray, truth: Truth, rng: np.random.Generator) -> np.ndarray:
    n = len(t)
    if name == "index":
        return np.arange(n, dtype=float)
    if name == "enable":
        return np.ones(n)
    if name == "supply_V":
        return np.round(12.0 + 0.2 * rng.standard_normal(n), 3)
    if name == "angle_true_rad":
        return np.round(truth.y(t), 9)
    return np.round(rng.standard_normal(n).cumsum() * 0.01 + 20.0 * (name == "temp"), 5)
