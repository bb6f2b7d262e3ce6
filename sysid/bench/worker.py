"""Runs a method file in a process of its own: `python worker.py METHOD FOLDER PACKAGE PARENT`, with numpy alone.

FOLDER holds data.npz (see `sysid.bench.isolation`). The worker writes `began` when the clock starts, then runs.npz and
done.json: details, seconds of the fit [s], peak memory [MiB], version; or a sentence in `status`.
"""

import ast
import contextlib
import importlib
import importlib.util
import json
import os
import sys
import threading
import time
import traceback
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

HERE = Path(__file__).parent
LARGEST = 2**30  # [byte] of a file, many times what a library's own cache needs


def module_at(path: Path, name: str) -> ModuleType:
    """The file as a module, under a name that no library has."""
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # a dataclass looks its own module up
    spec.loader.exec_module(module)
    return module


def import_all(path: Path) -> None:
    """Everything that the file imports, also inside functions, so that no import counts as time of the fit."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module]
        for name in names:
            with contextlib.suppress(ImportError):  # the method meets it again, and may know another way
                importlib.import_module(name)


def data_of(contract: ModuleType, arrays: Any) -> Any:
    """The `Data` of the contract from the arrays of data.npz."""
    count = int(arrays["experiments"])
    u, y, missing = (tuple(arrays[f"{name}{k}"] for k in range(count)) for name in ("u", "y", "missing"))
    orders = tuple(int(n) for n in arrays["orders"]) or None
    seconds, seed, model = float(arrays["seconds"]), int(arrays["seed"]), json.loads(str(arrays["model"]))
    return contract.Data(u, y, missing, float(arrays["Ts"]), orders, seconds, seed, model)


def work(contract: ModuleType, method: Path, folder: Path, package: str) -> dict[str, Any]:
    """Fit and run; the free runs go to runs.npz."""
    with np.load(folder / "data.npz") as arrays:
        signals = dict(arrays)
    data = data_of(contract, signals)
    import_all(method)
    fit = module_at(method, "qpal_method").fit
    (folder / "began").touch()
    contract.start_peak()
    start = time.perf_counter()
    model = fit(data)
    seconds, top = time.perf_counter() - start, contract.peak()
    runs = {}
    for k in range(int(signals["tests"])):
        u, first = signals[f"test{k}"], signals[f"first{k}"]
        runs[f"run{k}"] = contract.checked_run(model.simulate(u.copy(), first.copy()), len(u))
    np.savez(folder / "runs.npz", **runs)
    details = contract.details_of(model)
    version = package_version(package)
    return {"details": details, "seconds": seconds, "memory": top, "status": "ok", "version": version}


def package_version(package: str) -> str:
    """The version of a package in this environment, empty if there is none of that name."""
    try:
        return metadata.version(package) if package else ""
    except (metadata.PackageNotFoundError, ValueError):
        return ""


def limit_files() -> None:
    """No file of this process grows beyond `LARGEST`: a method that prints for ever does not fill the disk."""
    with contextlib.suppress(ImportError, OSError, ValueError):  # Windows, or a limit that is lower already
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST, LARGEST))


def end_with_parent(parent: int) -> None:
    """Leave when process `parent`, which started this one, is gone, so that nothing runs on after a kill."""
    if os.name != "posix":  # Python itself may stand between the two
        parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def main(method: str, folder: str, package: str, parent: str) -> int:
    """Exit status 0 with a result or a sentence in done.json; `parent` is the process that started this one."""
    end_with_parent(int(parent))
    limit_files()
    contract = module_at(HERE / "contract.py", "qpal_contract")
    try:
        result = work(contract, Path(method), Path(folder), package)
    except NotImplementedError as error:  # how a method says that it does not do this
        result = {"status": f"refused: {contract.text_of(str(error))}"}
    except BaseException as error:
        with contextlib.suppress(BaseException):
            traceback.print_exc()
        result = {"status": f"crashed: {contract.text_of(error)}"}
    (Path(folder) / "done.json").write_text(json.dumps(result), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
