"""Sessions of the app: damaged entries become sentences, and the rest opens and can be used."""

import json
import shutil
import tempfile
from functools import cached_property
from pathlib import Path

import numpy as np

from fuzz.logs import check as check_record
from fuzz.mutate import damaged, other_values
from fuzz.runner import WrongError, sentence
from sysid.base.errors import InputError
from sysid.data.record import IOData
from twin.app.desk import Desk
from twin.app.entries import Data, Finding, Model, Prepare, Setting, Study, Twin
from twin.app.samples import save_record
from twin.app.session import Session

SETTING = Setting(structure="output_error", settings={"nb": 1, "nf": 1, "nk": 1})
FIGURE = {"data": [], "layout": {"height": 300}}
SHARED = {"fit_estimation": 90.0, "fit_validation": None, "d": 3, "N": 20, "seconds": 1.0, "converged": True}


def build(folder: Path) -> None:
    """A session of two records, a model and a study."""
    session, t = Session.open(folder), np.arange(20.0)
    data = IOData(np.sin(t), np.cos(t), 0.1, u_name="u", y_name="y", u_unit="V", y_unit="rad")

    def record(place: Path) -> None:
        (place / "log.csv").write_text("u,y\n1,2\n")
        save_record(data, place / "record.npz")

    def model(place: Path) -> None:
        (place / "model.json").write_text("{}")
        np.savez(place / "runs.npz", t=t, y=t, run=t, border=np.array(1.0), name=np.array("y"), unit=np.array("rad"))
        (place / "figures.json").write_text(json.dumps({"fit": {"figure": FIGURE, "caption": "c"}}))

    def study(place: Path) -> None:
        (place / "figures.json").write_text(json.dumps({"strip": {"figure": FIGURE, "caption": "c"}}))

    advice = (Finding(sentence="it is short", action="record more", severity="note"),)
    chosen = {"input": "u", "output": "y", "Ts": 0.1, "columns": ("u", "y")}
    session.add(Data(name="one.csv", suffix=".csv", advice=advice, **chosen), record)
    steps = Prepare(start=0.2, detrend="mean")
    session.add(Data(name="two.csv", suffix=".csv", twin=Twin(seed=3), prepare=steps), record)
    session.add(Model(name="output_error (1,1,1)", data="d1", prepare=Prepare(), setting=SETTING, **SHARED), model)
    session.add(Study(kind="compare", data="d1", joint="thigh", sentences=("alike",)), study)
    session.change(shown="d2", setting=SETTING)
    session.close()


class Sessions:
    """Whatever a file holds, the session opens or a sentence says why not, and every entry that is there works."""

    name = "sessions"
    seconds = 3.0

    @cached_property
    def _whole(self) -> Path:
        folder = Path(tempfile.mkdtemp()) / "s"
        build(folder)
        return folder

    def ready(self) -> None:
        """The session, used once."""
        place = Path(tempfile.mkdtemp()) / "s"
        shutil.copytree(self._whole, place)
        assert check(place) == "read"
        shutil.rmtree(place.parent)

    def case(self, rng: np.random.Generator, folder: Path) -> str:
        """One session."""
        place = folder / "s"
        shutil.copytree(self._whole, place)
        files = sorted(path for path in place.rglob("*") if path.is_file() and path.name not in (".lock", "log.csv"))
        path = files[int(rng.integers(len(files)))]
        content = path.read_bytes()
        if path.suffix == ".json" and rng.random() < 0.7:
            path.write_text(json.dumps(other_values(rng, json.loads(content))), encoding="utf-8")
        else:
            path.write_bytes(damaged(rng, content))
        return check(place)


def check(folder: Path) -> str:
    """How a session ends."""
    session = Session.open(folder)
    desk = Desk(session)
    try:
        return "read" if used(desk) and not session.complaints else "refused"
    finally:
        desk.close()


def used(desk: Desk) -> bool:
    """Asks everything of the entries that a page shows; whether all of it was there."""
    session, whole = desk.session, True
    if any(sentence(said) != "refused" for said in session.complaints):
        raise WrongError(f"no sentence: {session.complaints}")
    asked = [session.head.setting.recipe]
    for key in session.data:
        asked += [
            lambda key=key: check_record(desk.record(key)),
            lambda key=key: check_record(desk.prepared_record(key)[0]),
        ]
        asked += [lambda key=key: session.log(key)]
    for key, model in session.models.items():
        asked += [model.setting.recipe, lambda key=key: desk.figures("models", key), lambda key=key: desk.runs(key)]
        asked += [lambda key=key: [desk.content("models", key, name) for name in desk.files("models", key)]]
        asked += [lambda key=key: desk.overlaid([key], "d1"), model.prepare.preparation]
    for key in session.studies:
        asked += [lambda key=key: desk.files("studies", key), lambda key=key: desk.figures("studies", key)]
    for question in asked:
        try:
            question()
        except InputError as error:
            if sentence(str(error)) != "refused":
                raise WrongError(f"no sentence: {error}") from None
            whole = False
    session.change(setting=session.head.setting)
    return whole
