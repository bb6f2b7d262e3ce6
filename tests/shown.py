"""One record and the models of it that tests of notebooks and figures show: made once a process."""

from functools import cache

import numpy as np

import sysid
from sysid.joint.parts import PartEvidence
from sysid.joint.posterior import JointFit
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
def joint_fit():
    parts = (
        PartEvidence("motor.stick", "higher friction at rest upward", "V", 0.5, 0.1, 0.3, 0.3, 1e4),
        PartEvidence("motor.loss", "friction proportional to the load", "", 0.0, 0.01, 0.2, 0.3, 0.02),
        PartEvidence("play.width", "backlash", "rad", 0.01, 0.02, 0.0, 0.015, 1.1),
    )
    return JointFit(linear(), "both", parts, 1, 4, warnings=("one", "two", "three", "four"))
