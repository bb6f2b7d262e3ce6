"""A fit of given parameters, and its exported files at work: compiled or executed, run over a record."""

import ctypes
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from cases import BLOCKS, STRUCTURES
from often import by_day

import sysid
from sysid.base.criteria import criteria
from sysid.block.block import StaticBlock
from sysid.blocks import CoastingPlay, Motor, StateSpace, TransferFunction
from sysid.data.preprocess import detrend
from sysid.estimation.result import Fit
from sysid.excitations import Sweep
from sysid.export import c as export_c
from sysid.export import python as export_python
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Stop
from sysid.structures import actuated_joint

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

AT_REST = (".v0", ".u0", ".x1", ".x2")  # parameters that a run for an input alone does not read

# A joint as the real ones are: slow, with a load over position, a crooked linkage and a little play.
JOINT = {
    **{"motor.gain": 0.0019, "motor.lag": 0.55, "motor.rise": 1.9, "motor.fall": 2.6, "motor.delay": 0.3},
    **{"motor.load1": 0.7, "motor.load2": -0.4, "motor.upper": 1.0, "motor.x0": 0.45, "motor.loss": 0.3},
    **{"motor.stick": 0.8, "motor.stick_speed": 0.002, "motor.load0": -0.4},
    **{"map.low": -0.9, "map.high": 0.4, "play.width": 0.012, "play.rest": 0.2},
    **{f"map.s{k}": (k / 8) ** 1.15 for k in range(1, 8)},
    **{"map.angle0": 0.9, "map.angle1": 2.2, "map.stroke": 0.4},
    **{"driver.lower": -0.4, "driver.upper": 0.7},
    **{"motor.jam": 1000.0, "play.drag": 0.02, "play.pull0": 0.005, "play.pull1": 0.01},
}
JOINTS = {
    "coasting": actuated_joint(knots=9, motor=Motor(load=3, jams=True), play=CoastingPlay()),
    "plain": actuated_joint(),
    "with_everything": actuated_joint(
        knots=9, driver="dead_zone", motor=Motor(load=3, loss=True, stribeck=True, substeps=3)
    ),
    "without_stops": actuated_joint(motor=Motor(load=0, delayed=False, stops=False), knots=None, play=False),
}


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


def chain_fit(chain, u):
    """Filters with poles 0.7 and 0.5, maps with the cases' numbers, other blocks beside their start on what comes."""
    rng, x, values = np.random.default_rng(0), u, []
    known = {(type(block), block.n_parameters): theta for block, theta in BLOCKS.values()}
    for block in chain.blocks:
        theta = block.start(x)
        if isinstance(block, TransferFunction):
            f = np.concatenate([np.poly([0.7, 0.5][: block.nf])[1:], np.zeros(max(block.nf - 2, 0))])
            theta[: block.nb + block.nf] = np.concatenate([0.3 + 0.1 * np.arange(block.nb), f])
        elif isinstance(block, StaticBlock) and (type(block), len(theta)) in known:
            theta = known[type(block), len(theta)]
        elif block.admissible(drawn := block.vary(theta, rng)):
            theta = drawn + 0.05 * rng.normal(size=len(drawn)) if isinstance(block, StateSpace) else drawn
        values.append(theta)
        x = block.output(theta, x)
    return made(chain, np.concatenate(values))


def structure_fit(name):
    """A fit of a structure of the cases, or of one of JOINTS as joint_NAME, and a function of N: an input for it."""
    if name.startswith("joint_"):
        chain = JOINTS[name.removeprefix("joint_")]
        return made(chain, [JOINT.get(n, 0.0) for n in chain.names]), sweep
    if name == "nlarx":
        u = excitation(N=500)
        data = detrend(sysid.IOData(u, np.tanh(np.roll(u, 1)), 0.1))
        fit = sysid.fit(sysid.structures.nlarx(2, 2, 1, units=2), data, starts=1)
        return replace(fit, u_offset=np.zeros(1), y_offset=np.zeros(1)), lambda N: excitation(N=N)
    return chain_fit(STRUCTURES[name].model(), excitation()), lambda N: excitation(N=N)


# By day structures none of which is part of another one; tests of single blocks have each block.
FITS = by_day(
    [*sorted(STRUCTURES), *(f"joint_{name}" for name in JOINTS)],
    *("actuated_joint", "armax", "bj", "coupled_drives", "hammerstein_wiener", "motor_profile", "nlarx", "process"),
    *("servo_joint", "state_space", "wiener_hammerstein", "joint_with_everything"),
)


def changed(value, factor):
    """The number moved by a factor, or by a little where it is zero, within its bounds."""
    return float(np.clip(value.start * factor if value.start else factor - 1.0, value.lower, value.upper))


def with_values(fit, source, values):
    """The fit whose parameters are those of the struct."""
    names = list(fit.model.names) if hasattr(fit.model, "names") else [f"network.{n}" for n in fit.network.names]
    theta = fit.theta.copy()
    for parameter, value in zip(source.parameters, values, strict=True):
        if parameter.place is not None:
            theta[names.index(parameter.name)] = value
    return replace(fit, theta=theta)


def sweep(N):
    """Whole crossings of a joint's stroke, which is held midway for a while."""
    u = Sweep(12.0, 10.0, jitter=0.5, shrink=0.6).generate(N, 0.1, np.random.default_rng([0, 11]))
    u[700:760] = 1.0  # less than friction: it sticks
    return u


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
        folder = Path(mkdtemp(dir=folder))  # a library of the same path would be the first one again
        file = export_c.write(fit, folder / f"{name}.c", single, **scale)
        self.source = export_c.written_source(fit, name, single, **scale)
        self.channels = (1, 1) if not hasattr(fit.model, "channels") else fit.model.channels
        self.name, self.real = name, np.float32 if single else np.float64
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
