r"""
A Hammerstein-Wiener plant, found again
=======================================

The plant is a saturation, a second-order filter and an output map of three slopes; all of its numbers are known. A
model of the same orders is fitted to 800 samples with 2 % noise, and runs freely over 400 samples that it has not
seen.
"""

import matplotlib.pyplot as plt
import numpy as np

import sysid
from sysid.plots import Run
from sysid.uncertainty import curves

plant = sysid.systems.system("textbook")
record = plant.record(1200, noise=0.02, rng=np.random.default_rng(0))
estimation, validation = record.split(2 / 3)

model = sysid.structures.hammerstein_wiener(nb=2, nf=2, nk=1, input="saturation", output="piecewise_linear")
fit = sysid.fit(model, estimation, starts=2, seed=0)

for true, found, std in zip(plant.poles, fit.poles, fit.pole_std, strict=True):
    print(f"pole: true {true:.4f}, found {found:.4f}, standard deviation {std:.4f}")

# %%
# The free run uses the input alone. What it leaves, in the last panel, should look like the noise.

runs = [Run(part, fit.simulate(part), fit.fit_percent(part)) for part in (estimation, validation)]
figure, axes = plt.subplots(3, figsize=(8, 6), layout="constrained")
sysid.plots.free_run(*runs, axes=axes)

# %%
# The maps, with bands of 95 % as wide as the lines here. The plant's input saturates at -1 and 1.4. A gain may move
# between the blocks, so the output map is drawn between signals of mean 0 and deviation 1: the dashed diagonal would
# be no nonlinearity.

figure, axes = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
sysid.plots.static_maps(curves.curves(sysid.information(fit, estimation)), axes=axes)

# %%
# A script of this gallery stops the build of the site if what it says no longer holds.

ceiling = 100 * (1 - 0.02)  # the fit of the plant's own output, about
assert fit.fit_percent(validation) > ceiling - 1.0
assert np.all(np.abs(np.sort_complex(fit.poles) - np.sort_complex(plant.poles)) < 4 * fit.pole_std)
