"""The page for users of MATLAB: every line runs in one namespace, and each task gives what it promises."""

import re
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from sysid.systems import system

mpl.use("Agg")
PAGE = (Path(__file__).parents[2] / "docs" / "matlab.md").read_text(encoding="utf-8")
TASKS = [part for part in PAGE.split("\n## ") if re.match(r"\d+\. ", part)]
TRUE_POLE = 0.75 + 0.37j  # of the plant `textbook`, to two decimals


def code(part: str) -> list[str]:
    (block,) = re.findall(r"^```python\n(.*?)^```", part, flags=re.DOTALL | re.MULTILINE)
    return block.strip().splitlines()


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """What the page's lines leave behind, all of them run in order; each task's own names under its number."""
    plant, folder = system("textbook"), tmp_path_factory.mktemp("matlab")
    d = plant.record(1000, 0.05, np.random.default_rng(1))
    table = np.column_stack([d.u, d.y])
    np.savetxt(folder / "log.csv", table, delimiter=",", header="voltage_V,angle_rad", comments="")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        space: dict = {"recorded": table}
        exec(code(PAGE.split("\n## ")[0])[0], space)
        for k, task in enumerate(TASKS, 1):
            before = dict(space)
            exec(compile("\n".join(code(task)), f"task {k}", "exec"), space)
            space[k] = {n: v for n, v in space.items() if isinstance(n, str) and before.get(n) is not v}
    return space


def test_fifteen_tasks_of_at_most_two_lines_each_with_the_toolbox_name():
    assert len(TASKS) == 15
    for k, task in enumerate(TASKS, 1):
        title = task.splitlines()[0]
        assert title.startswith(f"{k}. ")
        assert re.search(r"\(`.+`\)$", title), title
        lines = code(task)
        assert 1 <= len(lines) <= 2
        assert not any(";" in line or line.startswith(" ") for line in lines)
        assert max(map(len, lines)) <= 120


def test_load_plot_and_range(names):
    data, work, test = names["data"], names["work"], names["test"]
    np.testing.assert_array_equal(np.column_stack([data.u, data.y]), names["recorded"])
    assert (data.Ts, data.u_unit, data.y_unit) == (0.1, "V", "rad")
    assert (work.N, test.N) == (700, 300)
    np.testing.assert_array_equal(np.concatenate([work.y, test.y]), data.y)
    panels = names[2]["figure"].axes
    np.testing.assert_allclose(panels[1].lines[0].get_ydata(), np.degrees(data.y[:, 0]))


def test_advice_and_delay(names):
    assert {"nonlinearity"} <= {a.topic for a in names["findings"] if a.severity != "fine"}
    delay = names["delay"]
    assert delay.nk == 1
    assert delay.low <= 1 <= delay.high <= 2


def test_fits_and_what_they_begin_with(names):
    default, linear, grown, better = (names[n] for n in ("default", "linear", "grown", "better"))
    block = default.model.linear
    assert (block.nb, block.nf, block.nk) == (2, 3, 1)
    assert linear.criteria.mse > 10 * grown.criteria.mse
    assert abs(grown.poles[0] - TRUE_POLE) < 0.02
    assert better.criteria.loss <= grown.criteria.loss * (1 + 1e-12)
    assert better.record is names["work"]


def test_a_held_block_keeps_its_values_and_the_rest_is_found(names):
    held = names["held"]
    rows = {p.name: p for p in held.parameters if p.name.startswith("input")}
    assert [(p.value, p.free) for p in rows.values()] == [(-1.0, False), (1.4, False)]
    assert abs(held.poles[0] - TRUE_POLE) < 0.02
    assert held.model.free.sum() + 2 == names["grown"].model.free.sum()


def test_merged_experiments_and_ranking(names):
    assert names["both"].lengths == (700, 300)
    assert names["again"].criteria.N == 1000
    ranking = names["ranking"]
    assert len(ranking.rows) == 4
    assert ranking.rows[-1].structure == "output_error"
    assert ranking.rows[0].fit == pytest.approx(
        max(names[n].fit_percent(names["test"]) for n in ("grown", "held", "default"))
    )
    bars = names[11]["figure"].axes[0].patches
    assert max(bar.get_width() for bar in bars) == pytest.approx(ranking.rows[0].fit)


def test_residuals_parameters_and_modes(names):
    tests, held = names["tests"], names["held"]
    assert tests.white
    assert tests.independent
    np.testing.assert_array_equal(tests.autocorrelation, held.residual_tests(names["test"]).autocorrelation)
    assert "white" in names[12]["figure"].axes[0].get_title("left")
    value, std = names["values"]["linear.f1"]
    assert 0.0 < std < 0.1 * abs(value)
    mode = names["modes"][0]
    assert mode.hertz == pytest.approx(abs(np.log(TRUE_POLE)) / 0.1 / (2 * np.pi), rel=0.02)
    assert 0.0 < mode.hertz_std < 0.02


def test_bode_with_its_band(names):
    magnitude, phase = names[14]["figure"].axes
    assert magnitude.get_ylabel() == "magnitude [deg/V]"
    assert phase.get_ylabel() == "phase [deg]"
    assert all(len(ax.collections) == 1 for ax in (magnitude, phase))


def test_structure_search(names):
    found = names["found"]
    assert found.chosen.candidate.name == "hammerstein_wiener"
    assert found.fit.fit_percent(names["test"]) > 90.0
    assert found.fit.record is names["work"]


def test_every_call_that_the_text_names_exists(names):
    import sysid

    text = re.sub(r"^```.*?^```", "", PAGE, flags=re.DOTALL | re.MULTILINE)
    calls = set(re.findall(r"`(sysid(?:\.\w+)+)", text)) | set(
        re.findall(r"`((?:held|data|delay|found|tests)\.\w+)", text)
    )
    assert len(calls) > 12
    for call in calls:
        first, *rest = call.split(".")
        thing = sysid if first == "sysid" else names[first]
        for part in rest:
            thing = getattr(thing, part)
