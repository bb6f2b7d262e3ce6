"""A fit of given parameters, and its exported files at work: compiled or executed, run over a record."""

import ctypes
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

STRICT = ("-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror")
# What is put behind NAME.c, so that Python can drive it: a run of N samples with these parameters (all, in order).
DRIVER = """
int drive(const REAL *values, const REAL *u, REAL *y, int n);
int drive(const REAL *values, const REAL *u, REAL *y, int n)
{{
    {name}_params p = {name}_fit;
    {name}_state s;
    if (values) memcpy(&p, values, sizeof p);
    {name}_init(&s, &p);
    for (int t = 0; t < n; ++t) {{
        {step}
    }}
    return (int)(sizeof p / sizeof(REAL)) + 1000 * (int)(sizeof s / sizeof(REAL));
}}
"""


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


def compiler():
    """A C compiler; the test is skipped where there is none."""
    cc = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    return cc or pytest.skip("no C compiler (cc, gcc, clang) on this machine")


class Compiled:
    """The exported C, compiled without a single warning."""

    def __init__(self, fit, folder, name="model", single=False, **scale):
        file = export_c.write(fit, folder / f"{name}.c", single, **scale)
        self.source = export_c.written_source(fit, name, single, **scale)
        self.channels = (1, 1) if not hasattr(fit.model, "channels") else fit.model.channels
        self.real = np.float32 if single else np.float64
        step = f"y[t] = {name}_step(&s, &p, u[t]);"
        if self.channels != (1, 1):
            step = f"{name}_step(&s, &p, u + {self.channels[0]} * t, y + {self.channels[1]} * t);"
        text = file.read_text(encoding="utf-8") + DRIVER.format(name=name, step=step)
        (folder / "driven.c").write_text(text, encoding="utf-8")
        real = f"-DREAL={'float' if single else 'double'}"
        command = [compiler(), "-std=c99", *STRICT, real, "-shared", "-fPIC", folder / "driven.c"]
        subprocess.run([*command, "-o", folder / "driven.so", "-lm"], check=True)
        self.library = ctypes.CDLL(str(folder / "driven.so"))

    def run(self, u, values=None):
        """y of u, from the fit's parameters or from these, in the order of the struct."""
        u = np.ascontiguousarray(u, self.real)
        y = np.empty((len(u), self.channels[1]), self.real)
        given = None if values is None else np.ascontiguousarray(values, self.real)
        place = [None if a is None else ctypes.c_void_p(a.ctypes.data) for a in (given, u, y)]
        sizes = self.library.drive(*place, len(u))
        assert sizes == len(self.source.parameters) + 1000 * len(self.source.states)
        return y[:, 0] if y.shape[1] == 1 else y


def c_run(fit, u, folder, name="model", **scale):
    """Compile, and run over u; skips where there is no C compiler."""
    return Compiled(fit, folder, name, **scale).run(u)
