"""Methods of other libraries: one stand-alone file each, run in an environment of its own, and one line in `TABLE`."""

from pathlib import Path

from sysid.bench.outside import Outside
from sysid.bench.scaffold import load

NAMES = ("forty_lines", "jax_sysid", "nfoursid", "sklearn_narx", "sysidentpy", "torch_state_space")
TABLE: dict[str, Outside] = {name: load(Path(__file__).with_name(f"{name}.py")) for name in NAMES}
