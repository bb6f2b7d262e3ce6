r"""
Bode diagram with bands
=======================

The frequency response of a fitted model around a constant input, with bands of 95 %, beside the truth. The band is
narrow where the input had power, and wide elsewhere.
"""

import matplotlib.pyplot as plt
import numpy as np

import sysid
from sysid.model.tangents import tangent
from sysid.uncertainty import responses

plant = sysid.systems.system("textbook")
data = plant.record(500, noise=0.1, rng=np.random.default_rng(3))
model = sysid.structures.hammerstein_wiener(
    nb=2, nf=2, nk=1, input="saturation", output=sysid.blocks.PiecewiseLinear(4)
)
fit = sysid.fit(model, data, starts=2, seed=0)
response = responses.frequency(sysid.information(fit, data), u=0.2)

figure, axes = plt.subplots(2, figsize=(7, 5.2), sharex=True, layout="constrained")
sysid.plots.bode(response, axes=axes)
w = response.magnitude.x
G = tangent(plant.chain, plant.theta, 0.2)
z = np.exp(1j * w * plant.Ts)
true = np.polyval(G.B[::-1], 1 / z) / np.polyval(G.F[::-1], 1 / z)
axes[0].plot(w, np.abs(true), "--", color="#1f2933", label="truth")
axes[0].legend()
axes[1].plot(w, np.degrees(np.unwrap(np.angle(true))), "--", color="#1f2933")

# %%
# The same model as an object of python-control, to design on.

print(sysid.linear.tangent(fit, u=0.2))

m = response.magnitude
inside = np.mean((m.lower <= np.abs(true)) & (np.abs(true) <= m.upper))
print(f"the band of the magnitude holds the truth at {100 * inside:.0f} % of the frequencies")

# %%
# What the bands promise, and where they are known to be too narrow: :doc:`/intervals`.

assert inside > 0.9
