"""Servos on a bus: their registers, the line to them, a run of goals, and a stand-in without hardware."""
