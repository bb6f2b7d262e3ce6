"""Benchmark of the identifier on plants with known truth: `python -m sysid.bench run|report|speed`."""
