"""The motion of a motor by scipy's adaptive integration with events, beside which the blocks' own steps are judged."""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

EXACT = {"method": "LSODA", "rtol": 1e-10, "atol": 1e-13}


class Reference:
    """lag v' + v = gain (u - L(x) - F sign v) with stick, stops and jam; `load` is L(x), `values` are by name."""

    def __init__(self, load=lambda x: 0.0, **values):
        self.load = load
        self.p = {"stick": 0.0, "stick_speed": 1.0, "loss": 0.0, "jam": 0.0, "delay": 0.0, "v0": 0.0} | values
        self.p = {"lower": -np.inf, "upper": np.inf} | self.p

    def run(self, u):
        """Positions (N,) at the samples; u (N,) is held from sample to sample and acts `delay` late."""
        p, N = self.p, len(u)
        times = np.unique(np.concatenate([np.arange(N), np.arange(N - 1) + p["delay"]]))
        times = times[times <= N - 1]
        self.x, self.v, self.free = p["x0"], p["v0"], 0.0  # free: when a jam is over
        found = {0.0: self.x}
        for begin, end in pairwise(times):
            k = int(np.floor(0.5 * (begin + end) - p["delay"]))
            self._piece(u[max(k, 0)], begin, end)
            found[end] = self.x
        return np.array([found[float(t)] for t in range(N)])

    def _piece(self, volts, t, end):
        p = self.p
        while t < end:
            if self.free > t:
                t = min(self.free, end)
                continue
            load = self.load(self.x)
            lost = p["loss"] * abs(load)
            way = np.sign(self.v)
            if way == 0.0 and volts - load > p["rise"] + p["stick"] + lost and self.x < p["upper"]:
                way = 1.0
            elif way == 0.0 and volts - load < -(p["fall"] + p["stick"] + lost) and self.x > p["lower"]:
                way = -1.0
            if way == 0.0:  # the load changes only with the position: it rests
                self.v = 0.0
                return
            t = self._moves(volts, way, t, end)

    def _moves(self, volts, way, t, end):
        """Moves in direction `way` until `end`, a reversal or a stop; returns when."""
        p, stop = self.p, self.p["upper"] if way > 0 else self.p["lower"]

        def rate(_, s):
            load = self.load(s[0])
            friction = (p["rise"] if way > 0 else p["fall"]) + p["loss"] * abs(load)
            friction += p["stick"] * np.exp(-((s[1] / p["stick_speed"]) ** 2))
            return s[1], (p["gain"] * (volts - load - way * friction) - s[1]) / p["lag"]

        def turns(_, s):
            return s[1] * way

        def strikes(_, s):
            return (s[0] - stop) * way if np.isfinite(stop) else -1.0

        turns.terminal, turns.direction = True, -1
        strikes.terminal, strikes.direction = True, 1
        done = solve_ivp(rate, (t, end), (self.x, self.v), events=(turns, strikes), **EXACT)
        self.x, self.v = done.y[:, -1]
        if len(done.t_events[1]):
            t, speed = done.t_events[1][0], done.y_events[1][0][1]
            self.x, self.v, self.free = stop, 0.0, t + p["jam"] * abs(speed)
        elif len(done.t_events[0]):
            t, self.v = done.t_events[0][0], 0.0
        else:
            t = end
        return t
