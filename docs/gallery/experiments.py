r"""
Several experiments in one fit
==============================

Three short records of one plant, each with its own initial state, become one fit: :meth:`sysid.IOData.merge`.
Together they tell more than the best of them alone.
"""

import matplotlib.pyplot as plt
import numpy as np

import sysid
from sysid.uncertainty import intervals

plant = sysid.systems.system("textbook")
records = [plant.record(250, noise=0.05, rng=np.random.default_rng(seed)) for seed in range(3)]
records = [record.select(40 * k, 250) for k, record in enumerate(records)]  # they begin in motion

model = sysid.structures.hammerstein_wiener(
    nb=2, nf=2, nk=1, input="saturation", output=sysid.blocks.PiecewiseLinear(4)
)
alone = [sysid.fit(model, record, starts=1) for record in records]
merged = sysid.IOData.merge(*records)
together = sysid.fit(model, merged, starts=1)

# %%
# The interval of the pole's modulus, alone and together.

shown = {
    f"record {k}": sysid.information(fit, record) for k, (fit, record) in enumerate(zip(alone, records, strict=True), 1)
}
shown["together"] = sysid.information(together, merged)
moduli = {name: intervals.poles(info)[0].modulus for name, info in shown.items()}

figure, axes = plt.subplots(figsize=(7, 2.8), layout="constrained")
for row, m in enumerate(moduli.values()):
    axes.errorbar(m.value, row, xerr=[[m.value - m.lower], [m.upper - m.value]], fmt="o", color="#c2410c", capsize=4)
axes.axvline(abs(plant.poles[0]), color="#1f2933", ls="--", label="truth")
axes.set(yticks=range(len(moduli)), yticklabels=list(moduli), xlabel="modulus of the pole pair", title="95 % intervals")
axes.invert_yaxis()
axes.legend()

# %%
# Initial states belong to their experiment: each is estimated, none is shared.

width = {name: m.upper - m.lower for name, m in moduli.items()}
print({name: round(value, 4) for name, value in width.items()})
assert width["together"] < min(width[name] for name in width if name != "together")
assert moduli["together"].lower < abs(plant.poles[0]) < moduli["together"].upper
