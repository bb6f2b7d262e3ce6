"""Saved models: chains, linear models and nonlinear ARX networks with damaged text and other values."""

import json
import tempfile
from functools import cached_property
from pathlib import Path

import numpy as np

import sysid
from fuzz.mutate import damaged, other_values
from fuzz.runner import WrongError
from sysid.base.errors import InputError

SAVED = Path(__file__).resolve().parents[1] / "saved" / "v1"
NAMES = (
    "dead_zones",
    "fixed_bounds",
    "integrator",
    "output_error",
    "piecewise_linear",
    "several_outputs",
    "wiener_hammerstein",
)
OTHERS = ("wiener_hammerstein", "networks", "joint_jams", "profile")
JOINTS = 2  # the last of them are loaded and saved alone: to run one takes seconds
STEPS = 40  # samples of a run
OFTEN = 0.1  # part of the cases that also find an initial state and predict, which take longer


class Models:
    """A model that loads has finite numbers, runs to finite ones or a sentence, and is saved and loaded alike."""

    name = "models"
    seconds = 3.0

    @cached_property
    def _whole(self) -> list[str]:
        """Files of every kind of model."""
        names = (*NAMES, *OTHERS)
        paths = [*(SAVED / f"{name}.json" for name in names), Path(__file__).with_name("nlarx.json")]
        return [path.read_text(encoding="utf-8") for path in paths]

    @property
    def _joints(self) -> range:
        return range(len(NAMES) + len(OTHERS) - JOINTS, len(NAMES) + len(OTHERS))

    @cached_property
    def _parsed(self) -> list[dict]:
        return [json.loads(text) for text in self._whole]

    def ready(self) -> None:
        """Every kind of model is run once."""
        for k, text in enumerate(self._whole):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "model.json"
                path.write_text(text, encoding="utf-8")
                check(path, long=True, runs=k not in self._joints)

    def case(self, rng: np.random.Generator, folder: Path) -> str:
        """One file."""
        k = int(rng.integers(len(self._whole)))
        path = folder / "model.json"
        if rng.random() < 0.3:
            path.write_bytes(damaged(rng, self._whole[k].encode()))
        else:
            path.write_text(json.dumps(other_values(rng, self._parsed[k])), encoding="utf-8")
        long = rng.random() < OFTEN
        return check(path, long, k not in self._joints)


def check(path: Path, long: bool, runs: bool = True) -> str:
    """How a saved model ends."""
    fit = sysid.load(path)
    if not np.isfinite(fit.theta).all():
        raise WrongError("not finite: theta")
    again = fit.save(path.with_name("again.json"))
    if sysid.load(again).save(path.with_name("twice.json")).read_bytes() != again.read_bytes():
        raise WrongError("wrong number: saved and loaded, it is another model")
    assert str(fit)
    assert fit.parameters is not None
    if not runs:
        return "read"
    if isinstance(fit, sysid.Fit):
        nu, ny = fit.model.channels
        assert fit.poles is not None
    else:
        nu, ny = 1, 1
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, (STEPS, nu)), rng.uniform(-1, 1, (STEPS, ny))
    asked = [lambda: fit.simulate(u)]
    if long:
        data = sysid.IOData(u, y, fit.Ts)
        asked += [lambda: fit.simulate(data), lambda: fit.predict(data)]
    done = 0
    for run in asked:
        try:
            found = np.asarray(run())
        except InputError:
            continue
        done += 1
        diverges = not isinstance(fit, sysid.Fit)  # an ARX run is infinite from there on
        wrong = np.isnan(found) if diverges else ~np.isfinite(found)
        if wrong.any() and np.abs(fit.theta).max() < 1e3:
            raise WrongError("not finite: what the model gives")
    return "read" if done else "refused"
