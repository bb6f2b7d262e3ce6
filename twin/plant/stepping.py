"""Parallel simulation of many boards: commands in, board outputs out."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from twin.plant import slots

TIMESTEP = 0.001  # [s], as in the MJCF; times of an experiment are whole numbers of it
BLOCK = 2**24  # bytes of commands and sensors at a time
WARNINGS = 1  # a batch's `warning` holds which element was last concerned, then how often
_lock = threading.RLock()


@contextmanager
def boards() -> Iterator[None]:
    """MuJoCo with the boards' callbacks in every step; models without a board are not affected.

    MuJoCo has one such callback per process, so threads take turns.
    """
    from twin.plant import kernels  # compiled code, loaded by those who step

    with _lock:
        former = mujoco.get_mjcb_control(), mujoco.get_mjcb_sensor()
        mujoco.set_mjcb_control(kernels.control.ctypes)
        mujoco.set_mjcb_sensor(kernels.sense.ctypes)
        try:
            yield
        finally:
            mujoco.set_mjcb_control(former[0])
            mujoco.set_mjcb_sensor(former[1])


@dataclass(frozen=True)
class Run:
    """One simulation: its model with user data (nuserdata,) and starting qpos (nq,); commands (N, joints), each held
    for Ts, `delay` [s] late; `hold` (joints,) is the command during the preceding `settle` [s].
    `late` (N,) [s] is the timing error of each sample, less than Ts in absolute value.
    """

    model: mujoco.MjModel
    user_data: np.ndarray
    qpos: np.ndarray
    commands: np.ndarray
    hold: np.ndarray
    delay: float
    late: np.ndarray


def step(runs: Sequence[Run], Ts: float, settle: float, threads: int = 1) -> np.ndarray:
    """The board outputs (runs, N, joints, COLUMNS) at each sample, before its command is applied.

    All runs need the same number of samples, model layout and time step. The result is the same, bit for bit, for any
    number of runs and threads. Raises mujoco.batch.SimulationError if a simulation fails.
    """
    outputs, trouble = attempt(runs, Ts, settle, threads)
    if any(trouble):
        failures = [i for i, sentence in enumerate(trouble) if sentence]
        raise SimulationError(np.array(failures), trouble[failures[0]], len(runs))
    return outputs


def attempt(runs: Sequence[Run], Ts: float, settle: float, threads: int = 1) -> tuple[np.ndarray, list[str]]:
    """The result of `step`, NaN for failed runs, and the reason as one sentence per run, empty if it did not fail.

    Other runs are not affected. A MuJoCo warning counts as a failure: MuJoCo stops there, and the constant record would
    look like a joint at rest.
    """
    first = runs[0]
    N, joints = first.commands.shape
    h = first.model.opt.timestep
    steps_per_sample, lead = round(Ts / h), round(settle / h)
    batch = Batch(first.model, len(runs), threads)
    if any(run.model is not first.model for run in runs):
        batch.set_models([run.model for run in runs])
    batch.qpos = np.stack([run.qpos for run in runs])
    batch.userdata = np.stack([run.user_data for run in runs])
    instants = lead + (np.arange(N) * Ts + np.stack([run.late for run in runs])) / h
    instants = np.maximum(instants, 0.0)
    previous_step = np.floor(instants + 1e-6).astype(int)  # rounding must not take a sample on a step for one before it
    fraction = np.clip(instants - previous_step, 0.0, 1.0)
    outputs = np.zeros((len(runs), N, joints * slots.COLUMNS))
    trouble = [""] * len(runs)
    total = int(previous_step.max()) + 2
    block = max(steps_per_sample, BLOCK // (8 * len(runs) * joints * (1 + slots.COLUMNS)))
    with boards():
        for start in range(0, total, block):
            stop = min(start + block, total)
            ids = [i for i, sentence in enumerate(trouble) if not sentence]
            commands = np.stack([_commands(runs[i], np.arange(start, stop) - lead, steps_per_sample, h) for i in ids])
            rows = _roll(batch, ids, commands, trouble)
            part = slice(*_span(start, stop, lead, steps_per_sample, N))
            outputs[ids, part] += _take(rows, start, previous_step[ids, part], fraction[ids, part])
            if all(trouble):
                break
    outputs[[sentence != "" for sentence in trouble]] = np.nan
    return outputs.reshape(len(runs), N, joints, slots.COLUMNS), trouble


def _roll(batch: Batch, ids: list[int], commands: np.ndarray, trouble: list[str]) -> np.ndarray:
    """The board outputs of simulations `ids` for `commands` (ids, steps, joints); failed simulations are recorded."""
    rows = np.empty((*commands.shape[:2], batch.model.nsensordata))
    try:
        batch.rollout(commands.shape[1], commands, record=("sensordata",), ids=ids, out={"sensordata": rows})
    except SimulationError as error:  # the others ran to the end
        for i in error.ids:
            trouble[i] = f"MuJoCo stopped: {batch.error(int(i))}"
    for i in np.flatnonzero(batch.warning[:, :, WARNINGS].any(axis=1)):
        kind = int(batch.warning[i, :, WARNINGS].argmax())
        trouble[i] = trouble[i] or f"MuJoCo stopped: {mujoco.mju_warningText(kind, int(batch.warning[i, kind, 0]))}"
    return rows


def _commands(run: Run, steps: np.ndarray, steps_per_sample: int, h: float) -> np.ndarray:
    """The command (steps, joints) at the board at simulation steps counted from the first sample."""
    k = (steps - round(run.delay / h)) // steps_per_sample
    return np.where(k[:, None] < 0, run.hold, run.commands[np.clip(k, 0, len(run.commands) - 1)])


def _span(start: int, stop: int, lead: int, steps_per_sample: int, N: int) -> tuple[int, int]:
    """Samples that may fall between two simulation steps, plus one on either side."""
    return max((start - lead) // steps_per_sample - 2, 0), min((stop - lead) // steps_per_sample + 3, N)


def _take(rows: np.ndarray, start: int, previous_step: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    """The contribution of the steps `rows` (runs, steps, n) from `start` on to the samples, by linear interpolation."""
    out = np.zeros((*previous_step.shape, rows.shape[2]))
    for offset, share in ((0, 1.0 - fraction), (1, fraction)):
        k = previous_step + offset - start
        in_block = (k >= 0) & (k < rows.shape[1])
        values = rows[np.arange(len(rows))[:, None], np.where(in_block, k, 0)]
        out += np.where(in_block, share, 0.0)[..., None] * values
    return out
