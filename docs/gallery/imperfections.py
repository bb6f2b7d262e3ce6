r"""
The same voltage with and without an imperfection
=================================================

Every imperfection of the twin has a switch. One voltage, the thigh as it is, and the thigh without one of them: what
is between the lines is that imperfection's doing.
"""

import matplotlib.pyplot as plt
import numpy as np

import twin

setting = {"joint": "thigh", "excitation": "sweep", "duration": 40.0, "seed": 1}
setting["options"] = {"jitter": 0.5, "shrink": 0.4}
whole = twin.Experiment(**setting).run()
missing = ("friction", "gravity", "end_stops", "noise")
logs = {name: twin.Experiment(**setting, without=(name,)).run() for name in missing}

# %%
# Without friction the joint is faster. The weight of the leg helps it to larger angles, so without gravity it lags on
# its way up. Without end stops it runs on. Noise changes the reading and not the motion.

figure, axes = plt.subplots(len(missing), figsize=(8, 8), sharex=True, layout="constrained")
for ax, (name, log) in zip(axes, logs.items(), strict=True):
    ax.plot(log.t, np.rad2deg(log.y), color="#c2410c", label="without")
    ax.plot(whole.t, np.rad2deg(whole.y), "--", color="#1f2933", label="with")
    ax.set(ylabel="angle [deg]", title=name.replace("_", " "))
axes[0].legend(loc="lower left", ncols=2)
axes[-1].set(xlabel="time [s]")

# %%
# The truth that belongs to a leg: what an identifier should find in its logs.

truth = twin.truth(joint="thigh", Ts=0.1)
print("ends [deg]:", *(f"{angle:.1f}" for angle in np.rad2deg(truth.end_angles)))
print("voltage that starts the joint, down and up [V]:", *(f"{volt:.2f}" for volt in truth.breakaway_voltage))

apart = {name: np.rad2deg(np.sqrt(np.mean((log.y_true - whole.y_true) ** 2))) for name, log in logs.items()}
print({name: f"{rms:.2f} deg" for name, rms in apart.items()})
assert apart["friction"] > 1.0
assert apart["noise"] == 0.0
