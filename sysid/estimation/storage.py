"""Read a saved fit: every entry is checked, and the model is bit for bit the same.

Fields that are missing in an older file take their defaults. Derived criteria are computed again, so a file may have
fewer or more of them. Renames are in `sysid.estimation.migrations`.
"""

import json
import os
from dataclasses import fields
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from sysid.base.criteria import Criteria
from sysid.base.errors import InputError
from sysid.estimation.codec import build
from sysid.estimation.migrations import VERSION, migrate
from sysid.estimation.result import Fit
from sysid.estimation.saving import FORMAT


def load(path: str | os.PathLike) -> Fit:
    """Read a fit that `save` wrote; raises InputError, one sentence, for anything else."""
    source = Path(path)
    try:
        document = json.loads(source.read_text(encoding="utf-8"), parse_constant=_refused)
    except OSError as e:
        raise InputError(f"cannot read {source}: {e.strerror}; give the path of a saved fit") from None
    except UnicodeDecodeError:
        raise InputError(f"{source} is not text; give a file that save() wrote") from None
    except json.JSONDecodeError as e:
        raise InputError(
            f"{source} is incomplete or damaged at line {e.lineno}, column {e.colno} ({e.msg}); save the fit again"
        ) from None
    except (RecursionError, ValueError) as e:
        raise InputError(f"{source} is not a fit that save() wrote ({e}); give another file") from None
    try:
        return _fit(document)
    except InputError as e:
        raise InputError(f"{source}: {e}") from None


def _refused(constant: str) -> NoReturn:
    raise ValueError(f"it holds {constant}")


def _fit(document: Any) -> Fit:
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(
            f"this is JSON but not a saved fit (its format is not {FORMAT!r}); give a file that save() wrote"
        )
    version = document.get("version")
    if type(version) is not int or version < 1:
        raise InputError(f"version is {version!r}; give a file that save() wrote")
    if version > VERSION:
        raise InputError(
            f"saved by a newer version of this library (file version {version}, this one reads up to {VERSION}); "
            "update the library"
        )
    document = migrate(document, version)
    theta = document.get("theta")
    if not isinstance(theta, dict):
        raise InputError("theta is not a table of parameter names and values; save the fit again")
    body = {k: v for k, v in document.items() if k not in ("format", "version")}
    if isinstance(body.get("criteria"), dict):
        body["criteria"] = _criteria(body["criteria"])
    fit: Fit = build(Fit, {**body, "theta": list(theta.values())})
    _check(fit, list(theta))
    return fit


def _criteria(saved: dict[str, Any]) -> dict[str, Any]:
    """The stored criteria without the derived ones; nan for a loss that an older file does not have."""
    known = {"loss": "nan", "mse": "nan", **saved}
    return {f.name: known[f.name] for f in fields(Criteria) if f.name in known}


def _check(fit: Fit, names: list[str]) -> None:
    """Consistency checks between the fields of a fit."""
    model, P = fit.model, len(fit.model.names)
    if names != list(model.names):
        wrong = sorted(set(model.names) ^ set(names))[:3] or ["their order"]
        raise InputError(f"theta does not name the model's {P} parameters (see {', '.join(wrong)}); save the fit again")
    if fit.theta.shape != (P,) or fit.theta.dtype != float or not model.admissible(fit.theta):
        raise InputError(
            "theta is not a valid model (not finite, or unstable, or knots out of order); save the fit again"
        )
    if fit.covariance.cov.shape != (P, P) or fit.covariance.unidentifiable.shape != (P,):
        raise InputError(
            f"the covariance does not have a row and a column for each of {P} parameters; save the fit again"
        )
    if not 0 < fit.Ts < np.inf or fit.n_init < 0:
        raise InputError(f"Ts is {fit.Ts} and n_init {fit.n_init}; Ts must be above 0 and n_init not below 0")
