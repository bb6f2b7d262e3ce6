"""MJCF fragments of identified joints in MuJoCo: rolled out against the fit."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.export.mjcf import STEP, Fragment


@dataclass(frozen=True)
class Check:
    """Roll-out of a fragment (N,) beside the free run of its fit (N,), under the same input u (N,)."""

    u: np.ndarray
    chain: np.ndarray
    rolled: np.ndarray
    Ts: float

    @property
    def share(self) -> float:
        """RMS of the difference, as a share of the range of the free run."""
        return float(np.sqrt(np.mean((self.rolled - self.chain) ** 2)) / np.ptp(self.chain))

    @property
    def worst(self) -> float:
        """Largest difference, as a share of the range of the free run."""
        return float(np.abs(self.rolled - self.chain).max() / np.ptp(self.chain))


def check(fragment: Fragment, fit: Fit, data: IOData) -> Check:
    """The fragment against its fit, under the input of `data` from the fit's initial state."""
    u = data.u[: data.lengths[0], 0]
    free = fit.model.simulate(fit.theta, data.u[: len(u)]).ravel()
    return Check(u, free, rollout(fragment, u, data.Ts), data.Ts)


def rollout(fragment: Fragment, u: np.ndarray, Ts: float) -> np.ndarray:
    """The fragment's reading (N,) at k Ts, under u (N,) [V] held from sample to sample."""
    model = mujoco.MjModel.from_xml_string(fragment.model())
    data = mujoco.MjData(model)
    for name, value in fragment.start.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    if model.actuator_history[0, 0] > 0:  # a chain takes the input before the record as its first one
        mujoco.mj_initCtrlHistory(model, data, 0, None, np.full(int(model.actuator_history[0, 0]), u[0]))
    places = [int(model.joint(name).qposadr[0]) for name in fragment.reading]
    ends = np.round(np.arange(1, len(u) + 1) * Ts / STEP).astype(int)
    read, current_step = np.zeros(len(u)), 0
    for k, end in enumerate(ends):
        read[k] = data.qpos[places].sum()
        data.ctrl[0] = u[k]
        if end > current_step:
            mujoco.mj_step(model, data, int(end - current_step))
        current_step = end
    if not np.all(np.isfinite(read)) or any(w.number for w in data.warning):
        raise InputError("the fragment's simulation became unstable; give a larger torque_per_volt or link_inertia")
    return read
