"""Records that other people measured, each with its official split, dropped samples, unit and published errors.

They are not shipped. Their folder holds ced/, emps/, cascaded_tanks/, silverbox/, daisy/ and bam_xl330/ with the files
as they are downloaded; whoever has the package nonlinear_benchmarks can give its sets to `sysid.bench.layouts` instead.
Published errors: Champneys et al., "Baseline results for selected nonlinear system identification benchmarks",
IFAC-PapersOnLine 58 (15), 2024: the best linear model, a polynomial NARX, and the best listed there.
"""

import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.bench.task import Task
from sysid.data.record import IOData

FOLDER = "QPAL_RECORDS"  # the environment variable that names the folder
BENCHMARKS = "https://www.nonlinearbenchmark.org (or by pip install nonlinear_benchmarks, which keeps the files)"
DAISY = "https://homes.esat.kuleuven.be/~smc/daisy"
BAM = "https://github.com/Rhoban/bam"
FULL_DUTY = 885.0  # of an XL330's PWM, 100 % (ROBOTIS e-manual, XL330-M288-T, "Present PWM")
SERVO_TS = 0.005  # s; the logs come at 4 to 6 ms
HELD_OUT = 400  # gain of the servo's position loop whose logs are the test


def ced(folder: Path) -> Task:
    """Coupled electric drives: a motor's voltage to the belt's speed, whose sensor is blind to its sign."""
    t = _read_csv(folder / "ced" / "DATAUNIF.csv")
    records = [IOData(t[:, k], t[:, k + 2], 0.02) for k in (0, 1)]
    return Task(
        IOData.merge(*(record.select(0, 400) for record in records)),
        {f"test {k}": record.select(400, 500) for k, record in enumerate(records, 1)},
        10,
        "ticks/s",
        (2, 3, 1),
        published={"linear": "0.224 / 0.384", "polynomial NARX": "0.10 / 0.141", "best listed": "0.115 / 0.074"},
        given="ced: coupled electric drives, two records of uniformly drawn levels",
    )


def emps(folder: Path) -> Task:
    """Electro-mechanical positioning system: the voltage of a position loop to the carriage's position."""
    train, test = (_read_mat(folder / "emps" / f"{name}.mat") for name in ("DATA_EMPS", "DATA_EMPS_PULSES"))
    return Task(
        IOData(train["vir"], 1e3 * train["qm"], 1e-3),
        {"pulses": IOData(test["vir"], 1e3 * test["qm"], 1e-3)},
        20,
        "mm",
        (2, 2, 1),
        published={"linear": "5.53", "polynomial NARX": "5.17", "best listed": "2.64"},
        given="emps: electro-mechanical positioning system in closed loop; the test adds force pulses",
    )


def cascaded_tanks(folder: Path) -> Task:
    """Two tanks, one above the other: pump voltage to the level of the lower one, which may overflow."""
    t = _read_csv(folder / "cascaded_tanks" / "dataBenchmark.csv")
    return Task(
        IOData(t[:, 0], t[:, 2], 4.0),
        {"validation": IOData(t[:, 1], t[:, 3], 4.0)},
        50,
        "V",
        (2, 2, 1),
        published={"linear": "0.588", "polynomial NARX": "0.413", "best listed": "0.191"},
        given="cascaded_tanks: two tanks with overflow, a multisine of 1024 samples each",
    )


def silverbox(folder: Path) -> Task:
    """A circuit like a mass on a hardening spring (Duffing): volts to volts, here in mV."""
    t = 1e3 * _read_csv(folder / "silverbox" / "SNLS80mV.csv")[:, :2]
    record = IOData(t[:, 0], t[:, 1], 1 / 610.35)
    parts = {"multisine": (105712, 127400), "arrow": (100, 40575), "no extrapolation": (100, 32100)}
    return Task(
        record.select(40650, 105712),
        {name: record.select(*ends) for name, ends in parts.items()},
        50,
        "mV",
        (3, 2, 0),
        published={
            "linear": "6.96 / 14.4 / 6.58",
            "polynomial NARX": "0.64 / 2.25 / 0.57",
            "best listed": "0.36 / 0.26 / 0.32",
        },
        given="silverbox: electronic Duffing oscillator; the arrow's end goes beyond the estimation record's range",
    )


def hair_dryer(folder: Path) -> Task:
    """Heater voltage to air temperature, as the voltage of a thermocouple; first half and second half."""
    t = _text(folder / "daisy" / "hair_dryer.dat")
    record = IOData(t[:, 0], t[:, 1], 0.08)
    description = "hair_dryer: laboratory hair dryer, binary heater voltage"
    return Task(record.select(0, 500), {"second half": record.select(500, 1000)}, 50, "V", (2, 3, 1), given=description)


def robot_arm(folder: Path) -> Task:
    """A flexible robot arm: reaction torque of the structure to acceleration; first half and second half.

    Of ten output errors (two to six poles, delay 0 or 1) these orders have the least BIC on the first half.
    """
    t = _text(folder / "daisy" / "robot_arm.dat")
    record = IOData(t[:, 0], t[:, 1], 1.0)
    description = (
        "robot_arm: flexible robot arm under a swept sine; time counts in samples, since the source names no rate"
    )
    return Task(record.select(0, 512), {"second half": record.select(512, 1024)}, 50, "", (6, 6, 1), given=description)


def bam_xl330(folder: Path) -> Task:
    """A servo with a pendulum: volts on its motor to angle, fitted at three gains of its loop and run at a fourth."""
    logs = servo_logs(folder / "bam_xl330")
    return Task(
        IOData.merge(*(record for gain, _, record in logs if gain != HELD_OUT)),
        {name: record for gain, name, record in logs if gain == HELD_OUT},
        50,
        "rad",
        (2, 2, 1),
        given="bam_xl330: XL330 servo with a pendulum; logs of 6 s, the gain of the tests is held out",
    )


def servo_logs(folder: Path) -> list[tuple[int, str, IOData]]:
    """Gain of the position loop, trajectory and record of every log: volts (duty times supply) to angle [rad].

    The grid is even, at `SERVO_TS`. A log ends where its torque is switched off: a motor without terminals is another
    plant.
    """
    logs = []
    for log, columns in _servo_entries(folder):
        duty, y = columns["load"], columns["position"]
        volts = np.where(duty > 32767.0, duty - 65536.0, duty) / FULL_DUTY * columns["input_volts"]  # a signed word
        t = columns["timestamp"]
        grid = np.arange(t[0], t[-1], SERVO_TS)
        record = IOData(np.interp(grid, t, volts), np.interp(grid, t, y), SERVO_TS)
        logs.append((int(log["kp"]), str(log["trajectory"]), record))
    return logs


def servo_goals(folder: Path) -> list[tuple[int, str, IOData]]:
    """The same logs from the goal [rad] and, as a second input, the gain in shares of `HELD_OUT`, to angle [rad]."""
    logs = []
    for log, columns in _servo_entries(folder):
        t = columns["timestamp"]
        grid = np.arange(t[0], t[-1], SERVO_TS)
        u = np.column_stack([np.interp(grid, t, columns["goal_position"]), np.full(len(grid), log["kp"] / HELD_OUT)])
        record = IOData(u, np.interp(grid, t, columns["position"]), SERVO_TS)
        logs.append((int(log["kp"]), str(log["trajectory"]), record))
    return logs


def _servo_entries(folder: Path) -> Iterator[tuple[dict, dict[str, np.ndarray]]]:
    """The head of every log, and its columns while the torque is on."""
    paths = sorted(folder.glob("*.json"))
    if not paths:
        raise FileNotFoundError(folder / "*.json")
    for path in paths:
        log = json.loads(path.read_text(encoding="utf-8"))
        torque_on = np.array([entry["torque_enable"] for entry in log["entries"]], dtype=bool)
        n = len(torque_on) if torque_on.all() else int(torque_on.argmin())
        keys = ("timestamp", "position", "goal_position", "load", "input_volts")
        yield log, {key: np.array([entry[key] for entry in log["entries"][:n]], dtype=float) for key in keys}


RECORDS: dict[str, tuple[Callable[[Path], Task], str]] = {
    "bam_xl330": (bam_xl330, BAM),
    "cascaded_tanks": (cascaded_tanks, BENCHMARKS),
    "ced": (ced, BENCHMARKS),
    "emps": (emps, BENCHMARKS),
    "hair_dryer": (hair_dryer, DAISY),
    "robot_arm": (robot_arm, DAISY),
    "silverbox": (silverbox, BENCHMARKS),
}


@dataclass(frozen=True)
class Real:
    """Every record is one scenario; its seed only draws what a method draws. `folder`, else $QPAL_RECORDS, holds them.

    Signals have their own zero and no means are taken away: a motor's zero volts are no offset.
    """

    name: str = "real"
    about: str = "public records of others by their official protocols"
    folder: str | None = None

    def scenarios(self) -> Sequence[str]:
        """Names of the records."""
        return sorted(RECORDS)

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`. Raises InputError for an unknown name and for a record that is not there."""
        if scenario not in RECORDS:
            raise unknown("record", scenario, RECORDS)
        read, page = RECORDS[scenario]
        place = self.folder or os.environ.get(FOLDER)
        if not place:
            raise InputError(
                f"nobody said where the record {scenario} lies; download it from {page} and set {FOLDER} to the folder "
                "that holds it"
            )
        try:
            return read(Path(place))
        except FileNotFoundError as error:
            raise InputError(
                f"the record {scenario} is not there: no file {error.filename or error}; download it from {page} and "
                f"put it there, or set {FOLDER} to the folder that holds it"
            ) from None


def _check_file(path: Path) -> Path:
    if not path.is_file():
        raise FileNotFoundError(path)
    return path


def _read_csv(path: Path) -> np.ndarray:
    """The numbers of a CSV with one heading row; a trailing comma makes a last column of nan."""
    return np.genfromtxt(_check_file(path), delimiter=",", skip_header=1)


def _text(path: Path) -> np.ndarray:
    return np.loadtxt(_check_file(path))


def _read_mat(path: Path) -> dict[str, np.ndarray]:
    """The vectors (N,) of a MAT file by name."""
    from scipy.io import loadmat

    return {name: np.ravel(value) for name, value in loadmat(_check_file(path)).items() if not name.startswith("__")}
