r"""
Orders by cross-validation
==========================

Which order does a record support? Each candidate is fitted to all blocks of the record but one, and runs freely over
that one. The fit on the estimation data always rises with the order; the fit on blocks that were left out does not.
"""

import matplotlib.pyplot as plt
import numpy as np

import sysid

plant = sysid.systems.system("textbook")  # its filter is of the second order
data = plant.record(400, noise=0.1, rng=np.random.default_rng(4))

orders = range(1, 5)
models = [sysid.structures.hammerstein(n, n, 1, input="saturation") for n in orders]
results = [sysid.cross_validate(model, data, folds=4, starts=1) for model in models]

# %%
# The second order is enough: beyond it only the fit on the estimation data rises.

figure, axes = plt.subplots(figsize=(7, 3.6), layout="constrained")
axes.plot(orders, [np.mean(r.estimation) for r in results], "o--", color="#7a8794", label="estimation data")
axes.errorbar(
    orders,
    [r.mean for r in results],
    [r.std for r in results],
    fmt="o-",
    color="#c2410c",
    capsize=4,
    label="blocks left out",
)
axes.set(
    xlabel="order of the filter",
    ylabel="fit of the free run [%]",
    xticks=list(orders),
    title="four blocks, each left out once; bars: deviation between blocks",
)
axes.legend()

for order, result in zip(orders, results, strict=True):
    print(f"order {order}: estimation {np.mean(result.estimation):.1f} %, left out {result.mean:.1f} %")

# %%
# :func:`sysid.select` does this over all structures, maps and orders; on the command line it is ``qpal identify FILE
# --structure auto``.

left_out = [r.mean for r in results]
assert left_out[1] > left_out[0] + 2.0
assert max(left_out[2:]) < left_out[1] + 0.5
