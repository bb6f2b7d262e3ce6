"""What all tests share: where public records lie, and how long statistical runs are."""

import base64
import datetime
import gc
import os
import signal
import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from of_the_day import of_the_day
from often import FULL
from shares import in_shares

# Before numpy loads: workers of two BLAS threads each wait for each other (a test took 380 s instead of 10 s).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

settings.register_profile("qpal", deadline=None, max_examples=20, derandomize=True)
settings.load_profile("qpal")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in the background of a script: children inherit it,
    signal.signal(signal.SIGINT, signal.default_int_handler)  # and tests of Ctrl-C would send it to the deaf

DAY = pytest.StashKey[int | None]()

RECORDS = Path(os.environ.get("QPAL_RECORDS") or Path(__file__).resolve().parents[2] / "shared" / "data")

BLANK = base64.b64decode("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR42mP4DwABAQEAHLCMmQAAAABJRU5ErkJggg==")


@pytest.fixture(scope="session")
def records() -> Path:
    """Folder of public benchmark records, which the project does not ship."""
    if not RECORDS.is_dir():
        pytest.skip("the public benchmark records are neither beside the project (../shared/data) nor in $QPAL_RECORDS")
    return RECORDS


@pytest.fixture(scope="session")
def seeds() -> range:
    """Seeds of a statistical test: 100 with QPAL_FULL=1, a dozen otherwise."""
    return range(100 if FULL else 12)


@pytest.fixture(autouse=True)
def _figures_are_closed() -> Iterator[None]:
    """pyplot keeps what a test asked it for, and warns at the 21st: which test that is depends on their order."""
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")


@pytest.fixture(autouse=True, scope="module")
def _pictures_are_blank(request: pytest.FixtureRequest) -> Iterator[None]:
    """By day figures are built, not rendered, which takes longer than most fits; `pixels` marks who looks at them."""
    with pytest.MonkeyPatch.context() as patch:
        if not FULL and not request.node.get_closest_marker("pixels"):
            patch.setattr("sysid.base.style.png", lambda drawn, few=False: BLANK)
        yield


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Ten thousand tests and what they import stay to the end: the garbage collector took a third of the time to find
    them, and a twentieth of a run to look through them again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


def pytest_configure(config: pytest.Config) -> None:
    """A run without names takes the tests of one day; its workers take those of the same."""
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS and not config.option.keyword
    today = int(os.environ.get("QPAL_DAY") or datetime.date.today().toordinal())
    workerinput = getattr(config, "workerinput", None)
    config.stash[DAY] = workerinput["day"] if workerinput else today if whole and not FULL else None


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Without xdist there are no workers."""
    node.workerinput["day"] = node.config.stash[DAY]


def _page(item: pytest.Item) -> str:
    """The file of a test that shares a fixture with others, such as a page on which they go on from each other."""
    fixtures = item._fixtureinfo.name2fixturedefs if isinstance(item, pytest.Function) else {}
    shared = {name for name, found in fixtures.items() if found[-1].scope in ("module", "package", "class")}
    return item.nodeid.partition("::")[0] if shared - {"_pictures_are_blank"} else ""


@pytest.hookimpl(trylast=True)  # after pytest has grouped tests by their fixtures
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The nightly list is skipped by default, the tests of other days are left out of a run without names; every worker
    of xdist begins with long tests, so that none idles."""
    if (day := config.stash[DAY]) is not None:
        items[:], others = of_the_day(items, lambda item: item.nodeid.partition("[")[0], _page, day)
        config.hook.pytest_deselected(items=others)
    for item in items:
        if not FULL and item.get_closest_marker("nightly"):
            item.add_marker(pytest.mark.skip(reason="of the nightly list: QPAL_FULL=1 runs it"))
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if workers > 1:
        items[:] = in_shares(items, workers, lambda item: item.get_closest_marker("long"), lambda item: item.path)
