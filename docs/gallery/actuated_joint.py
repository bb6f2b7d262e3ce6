r"""
An actuated joint on a thigh log
================================

A motor with friction between two stops is fitted to a log of the twin's thigh. Its parameters are physical, so they
can be compared with the twin's own.
"""

import matplotlib.pyplot as plt
import numpy as np

import sysid
import twin
from sysid.plots import Run
from sysid.uncertainty import curves

experiment = twin.Experiment(
    joint="thigh", excitation="sweep", duration=125.0, seed=1, options={"jitter": 0.5, "shrink": 0.4}
)
estimation, validation = experiment.run().io().split(0.6)

model = sysid.structures.actuated_joint(play=False)
fit = sysid.fit(model, estimation, search="lm", starts=5, seed=0)

# %%
# The joint runs into both of its ends and rests there, and the free run follows. A linear filter between two static
# maps has no such state.

runs = [Run(part, fit.simulate(part), fit.fit_percent(part)) for part in (estimation, validation)]
figure, axes = plt.subplots(3, figsize=(8, 6), layout="constrained")
sysid.plots.free_run(*runs, axes=axes)

# %%
# The map from the stroke of the motor to the angle of the joint: the linkage.

figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
linkage = curves.curve(sysid.information(fit, estimation), "map")
sysid.plots.static_curve(
    linkage, axes=[axes], words=("linkage", "position of the motor [strokes]", "angle of the joint")
)

# %%
# The values that a data sheet would have, beside those of the twin, in degrees.

truth = twin.truth(joint="thigh", Ts=0.1)
values = {value.name: value for value in sysid.joint_values(fit, data=estimation)}
low, high = sorted(truth.end_angles)
for name, true in (("speed_per_volt", truth.gain), ("end_low", low), ("end_high", high)):
    print(f"{name:15} true {np.rad2deg(true):6.2f}, found {np.rad2deg(values[name].value):6.2f}")

# %%
# :doc:`/joint` says how a joint grows the parts that its record shows, and when a value counts as determined.

assert fit.fit_percent(validation) > 97.0
assert abs(values["speed_per_volt"].value / truth.gain - 1.0) < 0.05
assert abs(values["end_low"].value - low) < np.deg2rad(0.5)
