"""A fit whose output map is flat where the record went: nothing is known of its slopes, and nothing fails."""

import numpy as np

from sysid.blocks.saturation import Saturation
from sysid.blocks.transfer_function import TransferFunction
from sysid.data.record import IOData
from sysid.model.chain import Chain
from sysid.uncertainty.information import UNEXCITED, information_at


def test_a_map_that_is_flat_everywhere_determines_nothing_and_does_not_fail():
    u = np.sign(np.sin(0.1 * np.arange(400.0)))
    y = 0.01 * np.random.default_rng(0).standard_normal(400)
    flat = Saturation(role="output", found=(-0.5, 0.5))
    chain = Chain((TransferFunction(role="linear", nb=1, nf=1, nk=1), flat))
    theta = np.array([0.1, -0.9, 0.0, 0.2, 0.2])  # both limits the same
    info = information_at(chain, theta, IOData(u, y, 0.1))
    assert flat.mean_slope(chain.part(theta, flat)) == 0.0
    assert np.all(np.isfinite(info.factor))
    gain = np.eye(len(info.theta))[info.own][0]
    assert np.isnan(info.std_of(gain)[0])
    assert info.note_of(gain) == UNEXCITED
