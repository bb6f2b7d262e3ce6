r"""
A nonlinear ARX model: free run against one step
================================================

A nonlinear ARX model computes the next output from *measured* past outputs. One step ahead nearly every model looks
right, because the output hardly changes within a sample. What a simulation needs is the free run, where the model
feeds on its own past. The library never mixes the two.
"""

import matplotlib.pyplot as plt
import numpy as np

import sysid

plant = sysid.systems.system("textbook")
record = plant.record(900, noise=0.02, rng=np.random.default_rng(0), hold=(5.0, 40.0))
estimation, validation = record.split(0.5)

fits = {
    focus: sysid.fit(sysid.structures.nlarx(3, 3, 1, units=6, focus=focus), estimation, starts=2)
    for focus in ("prediction", "simulation")
}
for focus, fit in fits.items():
    one, free = fit.prediction_percent(validation), fit.fit_percent(validation)
    print(f"fitted for {focus}: one step ahead {one:.1f} %, free run {free:.1f} %")

# %%
# Top: one step ahead, from measured outputs. Below: both models in free run. Errors of the model that was fitted one
# step ahead add up.

predicted = fits["prediction"]
lines = [("one step ahead, fitted for prediction", predicted.predict(validation), "#2f6f8f")]
lines += [(f"free run, fitted for {focus}", fit.simulate(validation), "#c2410c") for focus, fit in fits.items()]
figure, axes = plt.subplots(3, figsize=(8, 6), sharex=True, sharey=True, layout="constrained")
for ax, (title, run, colour) in zip(axes, lines, strict=True):
    ax.plot(validation.t, validation.y, color="#1f2933", lw=1, label="measured")
    ax.plot(validation.t, run, color=colour, lw=1, label="model")
    ax.set(title=title, ylabel="output")
axes[0].legend(loc="upper right", ncols=2)
axes[-1].set(xlabel="time [s]")

# %%
# A structure with the plant's own blocks needs fewer parameters and is nearer in free run.

model = sysid.structures.hammerstein_wiener(2, 2, 1, "saturation", sysid.blocks.PiecewiseLinear(4))
blocks = sysid.fit(model, estimation, starts=1)
print(sysid.compare(validation, *fits.values(), blocks, labels=[*fits, "Hammerstein-Wiener"]))

assert predicted.prediction_percent(validation) > predicted.fit_percent(validation) + 10.0
assert fits["simulation"].fit_percent(validation) > predicted.fit_percent(validation) + 5.0
assert blocks.fit_percent(validation) > 97.0
