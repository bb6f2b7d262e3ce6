"""What a motor carries: a load over its position, or that of a joint behind a linkage, and the friction with it."""

from math import cos, sin, sqrt

from sysid.blocks.linkage import cosine_at, share_of, slope_at


def load_at(x, p, block):
    away = x - block.at
    load = p.load0 + p.load1 * away + p.load2 * away * away
    if block.periodic:
        a = block.turn * x
        load += p.sine1 * sin(a) + p.cosine1 * cos(a) + p.sine2 * sin(2.0 * a) + p.cosine2 * cos(2.0 * a)
    return load


def rise_at(x, p, block):
    """By how much the load rises with the place."""
    rise = p.load1 + 2.0 * p.load2 * (x - block.at)
    if block.periodic:
        a = block.turn * x
        waves = p.sine1 * cos(a) - p.cosine1 * sin(a) + 2.0 * (p.sine2 * cos(2.0 * a) - p.cosine2 * sin(2.0 * a))
        rise += block.turn * waves
    return rise


def lever_at(x, p, block):
    """Load and friction of the bearing behind a linkage, by virtual work torques by its slope, and how both rise."""
    cosine = cosine_at(x, p)
    away, slope = share_of(cosine, p) - block.at, slope_at(x, cosine, p)
    bend = p.stroke / (1.0 + p.stroke * (x - 0.5))
    bend -= slope * (p.angle1 - p.angle0) * cosine / sqrt(1.0 - cosine * cosine)
    torque = p.load0 + away * (p.load1 + away * (p.load2 + away * p.load3))
    rise = bend * torque + slope * (p.load1 + away * (2.0 * p.load2 + 3.0 * away * p.load3))
    return slope * torque, slope * p.bearing, slope * rise, slope * p.bearing * bend


def lost_of(load, hold, way, p):
    """Friction of the bearing, and of the screw under what it carries."""
    return hold + p.loss * abs(load + way * hold)
