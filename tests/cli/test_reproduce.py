"""`qpal reproduce` on a short record: every joint, model, check and figure; the same numbers at any thread count."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from pages import assert_stands_alone, without_seconds

import twin
from twin.cli import main
from twin.studies import protocol
from twin.view import stills


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory):
    """One short run of the protocol, that of .ci/run if it is the caller: exit code, folder, summary."""
    made = os.environ.get("QPAL_REPRODUCED")  # .ci/run has ended where its run's exit code is not 0
    folder = Path(made) if made else tmp_path_factory.mktemp("reproduce") / "out"
    code = 0 if made else main(["reproduce", "--duration", "60", "--out", str(folder)])
    return code, folder, json.loads((folder / "summary.json").read_text(encoding="utf-8"))


def test_reproduce_has_every_joint_model_and_check(reproduced):
    code, _, summary = reproduced
    assert list(summary["joints"]) == list(twin.JOINTS)
    for joint in summary["joints"].values():
        for model in ("default", "final"):
            assert 0 < joint[model]["fit_percent"]["validation"] <= joint["ceiling"] <= 100
            inside = all(abs(complex(pole["re"], pole["im"])) < 1 - 1e-9 for pole in joint[model]["poles"])
            assert joint[model]["stable"] == inside
        nlarx = joint["nlarx"]
        assert set(nlarx["fit_percent"]) == set(nlarx["one_step_fit_percent"]) == {"estimation", "validation"}
        assert nlarx["fit_percent"]["validation"] <= joint["ceiling"]
        assert nlarx["setting"]["orders"] == {"na": 2, "nb": 2, "nk": 1}
        assert joint["truth_error"] < 1e-3
    assert list(summary["beyond"]) == list(twin.JOINTS)
    for joint in summary["beyond"].values():
        for record in ("sweep", "drawn sweep"):
            assert joint[record]["actuated_joint"]["fit_percent"]["validation"] <= joint[record]["ceiling"] + 0.2
            assert joint[record]["paper_structure"]["setting"]["structure"] == "hammerstein_wiener"
        speed = joint["recovered"]["speed_per_volt"]
        assert speed["sweep"][0] > 0
        assert speed["truth"] > 0
    assert summary["ablation"] == {}
    assert len(summary["checks"]) == 9
    assert summary["holds"] == all(check["holds"] for check in summary["checks"])
    assert code == (0 if summary["holds"] else 1)


def test_reproduce_draws_the_papers_figures_17_to_40(reproduced):
    _, folder, _ = reproduced
    numbers = {int(path.name[:2]) for path in (folder / "figures").glob("[0-9]*.png")}
    assert numbers == set(range(17, 41))
    names = {path.stem for path in (folder / "figures").iterdir()}
    assert {*(f"beyond-{joint}" for joint in twin.JOINTS), "beyond-recovered"} <= names
    html = (folder / "report.html").read_text(encoding="utf-8")
    assert_stands_alone(html)
    for number in numbers:
        assert f"<figcaption>Figure {number}. " in html


SHOULDER_ALONE = """
import sys
from twin.cli import main
from twin.studies import protocol
protocol.PAPER = {"shoulder": protocol.PAPER["shoulder"]}
main(sys.argv[1:])
"""


@pytest.mark.nightly
def test_reproduce_gives_the_same_numbers_at_any_thread_count(reproduced, tmp_path):
    _, _, summary = reproduced
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    arguments = ["reproduce", "--duration", "60", "--json", "--out", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", SHOULDER_ALONE, *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, **threads},
        check=False,
    )
    assert done.stderr == ""
    found = json.loads(done.stdout)
    for part in ("joints", "beyond"):
        assert list(found[part]) == ["shoulder"]
        assert without_seconds(found[part]["shoulder"]) == without_seconds(summary[part]["shoulder"])


@pytest.fixture
def short_protocol(monkeypatch):
    """`qpal reproduce` on the shoulder alone."""
    monkeypatch.setattr(protocol, "PAPER", {"shoulder": protocol.PAPER["shoulder"]})


@pytest.mark.nightly
def test_reproduce_goes_on_without_a_renderer_and_ends_with_1_where_a_check_does_not_hold(
    short_protocol, monkeypatch, tmp_path, capsys
):
    def none():
        raise stills.NoRenderer("no OpenGL on this machine")

    monkeypatch.setattr(stills, "leg_stills", none)
    monkeypatch.setattr(protocol, "TRUTH_TOLERANCE", -1.0)
    assert main(["reproduce", "--duration", "60", "--out", str(tmp_path / "out")]) == 1
    assert "DOES NOT HOLD" in capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "DOES NOT HOLD" in page
    assert "no OpenGL on this machine" in page
