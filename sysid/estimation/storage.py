"""Read a saved fit: every entry is checked, and the model is bit for bit the same.

Fields that are missing in an older file take their defaults. Derived criteria are computed again, so a file may have
fewer or more of them. Renames are in `STEPS` of the codec.
"""

import json
import os
import shlex
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, NoReturn, TypeVar

import numpy as np

from sysid.base.checks import short_text
from sysid.base.criteria import Criteria
from sysid.base.errors import InputError
from sysid.base.files import check_regular_file
from sysid.base.limits import MOST, SAMPLES, SECONDS
from sysid.data.table import LARGEST
from sysid.estimation.codec import FORMAT, VERSION, build, migrate
from sysid.estimation.free_run import quiet
from sysid.estimation.result import Fit
from sysid.formats import TABLE
from sysid.solver.covariance import Covariance

F = TypeVar("F")


def load(path: str | os.PathLike) -> Fit:
    """Read a chain that `save` wrote; raises InputError, one sentence, for anything else."""
    return read(path, {FORMAT: build_fit})


def read(path: str | os.PathLike, formats: Mapping[str, Callable[[dict[str, Any]], F]]) -> F:
    """Read a file of one of `formats`, a function of the document for each; raises InputError for anything else."""
    source = check_regular_file(path)
    command = shlex.join(["qpal", "identify", str(source)])
    try:
        text = source.read_text(encoding="utf-8-sig")  # an editor of Windows may have saved it
        document = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_unique_entries)
    except OSError as e:
        raise InputError(f"cannot read {source}: {e.strerror}; give the path of a saved fit") from None
    except (UnicodeDecodeError, json.JSONDecodeError) as e:
        if source.suffix.lower() in TABLE and source.suffix.lower() != ".json":
            raise InputError(
                f"{source} is a log by its suffix and no saved model; give the model.json of a fit in its place, which "
                f"this makes of the log: {command}"
            ) from None
        if isinstance(e, UnicodeDecodeError):
            raise InputError(f"{source} is not text; give a file that save() wrote") from None
        raise InputError(
            f"{source} is incomplete or damaged at line {e.lineno}, column {e.colno} ({e.msg}); save the fit again"
        ) from None
    except (RecursionError, ValueError) as e:
        raise InputError(f"{source} is not a fit that save() wrote ({e}); give another file") from None
    try:
        _check_letters(document)
        if not isinstance(document, dict) or str(document.get("format")) not in formats:
            names = " or ".join(repr(name) for name in formats)
            other = isinstance(document, dict) and "format" in document
            of_log = "" if other else f", which this makes of a log: {command}"
            raise InputError(
                f"this is JSON but not a saved fit (its format is not {names}); give a file that save() wrote{of_log}"
            )
        with quiet():  # what large entries make of a check is not finite, and refused
            return formats[str(document["format"])](document)
    except InputError as e:
        raise InputError(f"{source}: {e}") from None


def _check_letters(document: Any) -> None:
    """Raises InputError for half of a letter, which JSON can name and no file can hold."""
    try:
        json.dumps(document, ensure_ascii=False).encode()
    except UnicodeEncodeError as e:
        raise InputError(
            f"a text or name in it holds \\u{ord(e.object[e.start]):04x}, half of a letter, near "
            f"{e.object[max(e.start - 20, 0) : e.start]!r}; correct that text, or save the fit again"
        ) from None


def _refuse_constant(constant: str) -> NoReturn:
    raise ValueError(f"it holds {constant}")


def _unique_entries(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A table of the file; JSON's last entry of a name would silently replace those before it."""
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"it names {next(name for name in names if names.count(name) > 1)[:40]!r} twice in one table")
    return table


def version_of(document: dict[str, Any], newest: int) -> int:
    """The version of a document; raises InputError for one that is newer than `newest`, or none."""
    version = document.get("version")
    if type(version) is not int or version < 1:
        raise InputError(f"version is {version!r}; give a file that save() wrote")
    if version > newest:
        raise InputError(
            f"saved by a newer version of this library (file version {version}, this one reads up to {newest}); "
            "update the library"
        )
    return version


def build_fit(document: dict[str, Any]) -> Fit:
    """The fit of a document; raises InputError for entries that are missing, wrong or do not belong together."""
    fit, names = build_checked(Fit, migrate(document, version_of(document, VERSION)))
    _check(fit, names)
    return fit


def build_checked(kind: type[F], document: dict[str, Any]) -> tuple[F, list[str]]:
    """A fit of this kind from its document, and the names of the parameters there."""
    theta = document.get("theta")
    if not isinstance(theta, dict):
        raise InputError("theta is not a table of parameter names and values; save the fit again")
    body = {k: v for k, v in document.items() if k not in ("format", "version")}
    if isinstance(body.get("criteria"), dict):
        body["criteria"] = _criteria(body["criteria"])
    return build(kind, {**body, "theta": list(theta.values())}), list(theta)


def _criteria(saved: dict[str, Any]) -> dict[str, Any]:
    """The stored criteria without the derived ones; nan for a loss that an older file does not have."""
    values = {"loss": "nan", "mse": "nan", **saved}
    return {f.name: values[f.name] for f in fields(Criteria) if f.name in values}


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
    _check_fixed(fit)
    if not 0 < fit.Ts <= SECONDS or not 0 <= fit.n_init <= SAMPLES:
        raise InputError(
            f"Ts is {fit.Ts:g} and n_init {short_text(fit.n_init)}; Ts must be above 0 and n_init not below 0, "
            "and both of a size that a record can have"
        )
    check_numbers(fit.theta, fit.covariance, fit.criteria)
    check_offsets(fit.u_offset, fit.y_offset, model.channels)
    check_span("u_span", fit.u_span)
    check_span("y_span", fit.y_span)
    if fit.noise is not None and (len(fit.noise) != model.channels[1] or not np.all(np.isfinite(np.hstack(fit.noise)))):
        raise InputError(f"noise is not a row of finite numbers for each of {model.channels[1]} output(s); save again")


def _check_fixed(fit: Fit) -> None:
    """Raises InputError for a parameter beside the value at which the model holds it, but for rounding.

    A parameter beside its bounds is a warning of the fit: a block's own limits may move it there.
    """
    rounding = 1e-12 * float(np.abs(fit.theta).max(initial=0.0))
    for name, fixed_value in fit.model.fixed.items():
        value = float(fit.theta[fit.model.names.index(name)])
        if abs(value - fixed_value) > 1e-9 * max(abs(value), abs(fixed_value)) + rounding:
            raise InputError(f"{name} is {value:g} and fixed at {fixed_value:g}; save the fit again")


def check_numbers(theta: np.ndarray, covariance: Covariance, criteria: Criteria) -> None:
    """Raises InputError for numbers that no fit has."""
    check_sizes(theta)
    P = theta.size
    if covariance.cov.shape != (P, P) or covariance.unidentifiable.shape != (P,):
        raise InputError(
            f"the covariance does not have a row and a column for each of {P} parameters; save the fit again"
        )
    if covariance.unidentifiable.dtype != bool:
        raise InputError("unidentifiable of the covariance is not a list of true and false; save the fit again")
    at_bound = covariance.at_bound
    if at_bound is not None and (at_bound.shape != (P,) or at_bound.dtype != bool):
        raise InputError(f"at_bound of the covariance is not a list of {P} values true or false; save the fit again")
    variances = np.diag(covariance.cov)
    if (
        np.any(variances < -1e-9 * np.abs(variances).max(initial=0.0)) or covariance.noise_variance < 0
    ):  # but for rounding
        raise InputError("the covariance has a variance below 0; save the fit again")
    if not 1 <= criteria.N <= MOST or not 0 <= criteria.d <= MOST or criteria.loss < 0 or criteria.mse < 0:
        raise InputError(
            f"the criteria have N = {criteria.N}, d = {criteria.d}, loss = {criteria.loss:g} and mse = "
            f"{criteria.mse:g}; N is at least 1, none of the others is below 0 and no count above {MOST:,}: save the "
            "fit again"
        )


def check_sizes(values: np.ndarray) -> None:
    """Raises InputError for a parameter (n,) beyond the largest number of a record."""
    if values.size and np.abs(values).max() > LARGEST:
        raise InputError(f"a parameter is {np.abs(values).max():g}, above {LARGEST:g}; save the fit again")


def check_span(name: str, span: tuple[float, float]) -> None:
    """Raises InputError for a range of a signal that no record has."""
    if not -LARGEST <= span[0] <= span[1] <= LARGEST:
        raise InputError(f"{name} is {span[0]:g} to {span[1]:g}, which is no range of a record; save the fit again")


def check_offsets(u_offset: np.ndarray | None, y_offset: np.ndarray | None, channels: tuple[int, int]) -> None:
    """Raises InputError unless there is one finite offset for each of these inputs and outputs, or none is known."""
    if u_offset is None and y_offset is None:
        return
    for name, offset, n in (("u_offset", u_offset, channels[0]), ("y_offset", y_offset, channels[1])):
        if offset is None or offset.shape != (n,) or not np.all(np.isfinite(offset)):
            raise InputError(f"{name} is not a finite number for each of {n} channel(s); save the fit again")
