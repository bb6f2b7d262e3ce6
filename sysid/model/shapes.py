"""Parameters and inputs of a chain in their shape: compiled loops read beyond an array that is too short."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

import numpy as np

from sysid.base.checks import array, checked, short_text
from sysid.base.errors import InputError

C = TypeVar("C", bound=Callable[..., Any])


def of_theta(method: C) -> C:
    """A method of a chain, `method(self, theta, ...)`, that raises InputError unless theta is (P,).

    What is no array of floats yet is checked and made one. Values of such an array are not looked at: the method is
    called in every step of a search, where a value that is not finite gives one that is not.
    """
    late = checked(late=True)(method)

    @wraps(method)
    def guarded(self: Any, theta: Any, *args: Any, **kwargs: Any) -> Any:
        return late(self, _parameters(theta, self.names), *args, **kwargs)

    return cast(C, guarded)


def _parameters(theta: Any, names: tuple[str, ...]) -> np.ndarray:
    """theta (P,) as floats, one value for each of `names`."""
    if type(theta) is np.ndarray and theta.dtype == np.float64 and theta.shape == (len(names),):
        return theta
    found = array("theta", theta)
    if found.shape != (len(names),):
        has = f"{len(names)} parameter{'s' if len(names) != 1 else ''}"
        listed = f" ({', '.join(names[:8])}{', ...' if len(names) > 8 else ''})" if names else ""
        raise InputError(f"theta is {short_text(found)} and the chain has {has}{listed}; give one value for each")
    return found


def columns(u: Any, inputs: int) -> list[np.ndarray]:
    """The channels of u (N, inputs), or (N,) for one, each contiguous; raises InputError for another shape."""
    if type(u) is not np.ndarray or u.dtype != np.float64:
        u = array("u", u)
    if u.ndim not in (1, 2) or (1 if u.ndim == 1 else u.shape[1]) != inputs:
        rows = "(N,) or (N, 1)" if inputs == 1 else f"(N, {inputs})"
        raise InputError(f"u is {short_text(u)} and the chain has {inputs} input(s); give an array of shape {rows}")
    return [np.ascontiguousarray(column) for column in (u[None, :] if u.ndim == 1 else u.T)]
