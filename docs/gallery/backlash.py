r"""
Backlash: a width from a record
===============================

A play block behind a filter. At each reversal the output waits until the drive has crossed the width; output over
drive is a loop. The width is a parameter like every other, with an exact derivative and an interval.
"""

import matplotlib.pyplot as plt
import numpy as np

import sysid
from sysid.blocks import Play, TransferFunction
from sysid.uncertainty import intervals

WIDTH, Ts, N = 0.4, 0.05, 800
rng = np.random.default_rng(3)
plant = sysid.Chain((TransferFunction(1, 1, 1, role="linear"), Play(role="play")))
known = {"linear.b0": 0.2, "linear.f1": -0.8, "play.width": WIDTH}
true = np.array([known.get(name, 0.0) for name in plant.names])

u = sysid.excitations.excitation("multisine", amplitude=1.5, f_max=0.5).generate(N, Ts, rng)
y = plant.simulate(true, u)
data = sysid.IOData(u, y + 0.02 * rng.standard_normal(N), Ts)

# A chain of your own has no automatic start: give some. Half and twice the guess is near enough.
guess = {"linear.b0": 0.5, "linear.f1": -0.5, "play.width": 0.3}
starts = np.array([[scale * guess.get(name, 0.0) for name in plant.names] for scale in (0.5, 1.0, 1.5)])
fit = sysid.fit(plant, data, start=starts)
found = intervals.parameters(sysid.information(fit, data))["play.width"]
print(f"width: true {WIDTH}, found {found.value:.4f}, 95 % interval {found.lower:.4f} to {found.upper:.4f}")

# %%
# Left: the loop, measured and modelled. Right: a filter without backlash, fitted to the same record, is off at every
# reversal.

linear = sysid.fit(sysid.structures.output_error(1, 1, 1), data)
drive = plant.blocks[0].output(plant.part(fit.theta, plant.blocks[0]), u)
seconds = slice(0, 200)
figure, (loop, time) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
loop.plot(drive, data.y, ".", color="#1f2933", ms=2, label="measured")
loop.plot(drive, fit.simulate(data), color="#c2410c", lw=0.7, label="model")
loop.set(xlabel="drive", ylabel="output", title="output over drive")
loop.legend()
time.plot(data.t[seconds], data.y[seconds], color="#1f2933", label="measured")
time.plot(data.t[seconds], linear.simulate(data)[seconds], "--", color="#2f6f8f", label="without backlash")
time.plot(data.t[seconds], fit.simulate(data)[seconds], color="#c2410c", label="with backlash")
time.set(ylim=(-2.6, 1.4), xlabel="time [s]", ylabel="output", title="the first ten seconds")
time.legend(loc="lower right")

# %%
# A record whose output never reverses, or a link that its weight holds on one side, has no such loop: there the width
# is not determined, and :func:`sysid.joint_values` says so.

assert found.lower < WIDTH < found.upper
assert found.upper - found.lower < 0.05
assert linear.fit_percent(data) < fit.fit_percent(data) - 5.0
