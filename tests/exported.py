"""A fit of given parameters, and its exported files at work: compiled or executed, run over a record."""

import shutil
import subprocess

import numpy as np
import pytest

from sysid.base.criteria import criteria
from sysid.estimation.result import Fit
from sysid.export import c as export_c
from sysid.export import python as export_python
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Stop


def made(chain, theta):
    """A fit of these parameters, as if a search had found them."""
    P = len(chain.names)
    assert len(theta) == P
    cov = Covariance(np.zeros((P, P)), np.zeros(P, dtype=bool), 1.0)
    return Fit(
        chain, np.array(theta), 0.1, criteria(1.0, 100, P), cov, Stop("", True, 0, 0), (), (), (1.0,), 0.0, "lm", 8
    )


def excitation(n=1, N=400):
    """Holds and noise, beyond the ends of every map too."""
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-3, 3, (N // 5, n)), 5, axis=0) + 0.3 * rng.normal(size=(N, n))
    u[17] = 0.0
    return u[:, 0] if n == 1 else u


def agrees(y, expected):
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def python_space(fit, **scale):
    """What a person has who imports the exported file."""
    space = {"__name__": "exported"}
    exec(compile(export_python.source(fit, **scale), "exported.py", "exec"), space)
    return space


def python_run(fit, u, **scale):
    return np.array(python_space(fit, **scale)["simulate"](np.asarray(u).tolist()))


def c_run(fit, u, folder, name="model", **scale):
    """Compile without a single warning, feed u as text, read y back; skips where there is no C compiler."""
    cc = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if cc is None:
        pytest.skip("no C compiler (cc, gcc, clang) on this machine")
    file = export_c.write(fit, folder / "exported.c", name, **scale)
    strict = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    subprocess.run([cc, *strict, f"-D{name.upper()}_MAIN", file, "-o", folder / "run", "-lm"], check=True)
    text = "\n".join(" ".join(repr(float(v)) for v in np.atleast_1d(row)) for row in u)
    done = subprocess.run([folder / "run"], input=text, capture_output=True, text=True, check=True)
    y = np.array([[float(v) for v in line.split()] for line in done.stdout.splitlines()])
    return y[:, 0] if y.shape[1] == 1 else y
