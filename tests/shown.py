"""One record and the models of it that tests of notebooks and figures show: made once a process."""

from functools import cache

import numpy as np

import sysid
from sysid.joint.growth import Growth
from sysid.joint.rounds import Step
from sysid.systems import system

NAME = "<b>volt & more</b>"  # a column may be called anything


@cache
def data():
    d = system("textbook").record(500, 0.05, np.random.default_rng(1))
    return sysid.IOData(d.u, d.y, d.Ts, NAME, "angle", "V", "rad")


@cache
def fit():
    model = sysid.structures.hammerstein_wiener(nb=2, nf=2, nk=1, input="saturation")
    return sysid.fit(model, data(), search="lm", starts=1)


@cache
def linear():
    return sysid.fit(sysid.structures.output_error(nb=1, nf=1, nk=1), data(), search="lm", starts=1)


@cache
def network():
    return sysid.fit_nlarx(sysid.structures.nlarx(units=2), data(), starts=1).remember(data())


@cache
def growth():
    steps = (
        Step(0, "stribeck", -100.0, 50.0, True),
        Step(0, "loss", -40.0, -10.0, False),
        Step(1, "plays", -101.0, 1.0, False),
    )
    return Growth(linear(), -50.0, steps, warnings=("one", "two", "three", "four"))
