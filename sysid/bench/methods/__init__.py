"""Methods of the benchmark by name; several of one kind may share a file.

A method of this library is a file here and a line in `TABLE`. A method of another library is a file of
`sysid.bench.isolation.peer_folder`, which stands alone and imports no `sysid`.
"""

from sysid.bench.isolation import FileMethod, peer_folder
from sysid.bench.method import Method
from sysid.bench.method_file import load
from sysid.bench.methods.library import FROM_TRUTH, METHODS
from sysid.bench.methods.physical import METHODS as PHYSICAL

GENERAL = tuple(method.name for method in METHODS)  # of this library, for any record
OURS = (*GENERAL, *(method.name for method in PHYSICAL))  # with those that are made for one record
PEERS: dict[str, FileMethod] = {path.stem: load(path) for path in sorted(peer_folder().glob("*.py"))}
TABLE: dict[str, Method] = {**{method.name: method for method in (FROM_TRUTH, *METHODS, *PHYSICAL)}, **PEERS}
