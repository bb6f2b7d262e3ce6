"""The leaderboard against tables whose answers are known by hand, its sentences, and its pages."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from fakes import rows, run_of_the_library

from sysid.base.errors import InputError
from sysid.bench import leaderboard as boards
from sysid.bench import presentation
from sysid.bench.cell import redraw
from sysid.bench.leaderboard import worst_to_draw
from sysid.bench.method import Outcome
from sysid.bench.presentation import markdown
from sysid.bench.task import Task, Truth
from sysid.data.record import IOData
from sysid.report import bench as pages


@pytest.fixture
def table() -> pl.DataFrame:
    """Three methods on two scenarios with two seeds each; on f/b the search from the truth crashed with seed 1."""
    return rows(
        scenario=["f/a", "f/a", "f/b", "f/b"] * 3,
        seed=[0, 1] * 6,
        method=["from_truth"] * 4 + ["ours"] * 4 + ["peer"] * 4,
        status=["ok", "ok", "ok", "crashed: E"] + ["ok"] * 4 + ["ok", "refused: x", "stopped after 9 s", "ok"],
        fit=[90.0, 80.0, 70.0, None, 90.05, 79.95, 69.5, 60.0, 80.0, None, None, 61.5],
        seconds=[1.0, 1.0, 1.0, 1.0, 0.0, 3.0, 0.0, 3.0, 7.0, 7.0, 7.0, 7.0],
    )


def gaps(scored: pl.DataFrame, method: str) -> list[float]:
    return scored.filter(pl.col("method") == method).sort("scenario", "seed")["gap"].to_list()


def test_the_bar_is_the_fit_from_the_truth_and_else_the_best_fit(table):
    scored = boards.score_rows(table)
    assert gaps(scored, "ours") == pytest.approx([-0.05, 0.05, 0.5, 1.5])
    assert gaps(scored, "peer") == [10.0, np.inf, np.inf, 0.0]
    at_best = scored.filter(pl.col("bar_is") == boards.AT_BEST)
    assert set(at_best.select("scenario", "seed").rows()) == {("f/b", 1)}


def test_a_plant_that_is_no_chain_has_its_noise_free_output_as_bar(table):
    known = table.with_columns(oracle=pl.when(pl.col("scenario") == "f/b").then(65.0))
    scored = boards.score_rows(known)
    assert gaps(scored, "ours") == pytest.approx([-0.05, 0.05, 0.5, 5.0])  # the bar of (f/b, 1) failed
    assert scored.filter(pl.col("bar_is") == boards.AT_ORACLE)["bar"].to_list() == [65.0] * 3


def test_the_bar_does_not_fail_where_the_plant_is_no_chain(table):
    refused = table.with_columns(status=pl.col("status").str.replace("crashed: E", "refused: no chain"))
    board = boards.leaderboard(boards.score_rows(refused))
    assert board.filter(pl.col("method") == "from_truth")["n"].to_list() == [3]


def test_the_leaderboard_by_hand(table):
    board = boards.leaderboard(boards.score_rows(table))
    ours, peer, bar = board.to_dicts()
    assert [row["method"] for row in (ours, peer, bar)] == ["ours", "peer", "from_truth"]
    assert (ours["n"], ours["near_0.1"], ours["near_1"]) == (4, 2, 3)
    assert ours["lost"] == pytest.approx((-0.05 + 0.05 + 0.5 + 1.5) / 4)
    assert peer["lost"] == pytest.approx((10.0 + 100.0 + 100.0 + 0.0) / 4)
    assert ours["gap_worst"] == pytest.approx(1.5)
    assert np.isinf(peer["gap_worst"])
    assert (peer["crashed"], peer["stopped"], peer["refused"], bar["crashed"]) == (0, 1, 1, 1)
    assert ours["seconds"] == pytest.approx(1.0)  # sqrt(1 * 4) - 1
    assert peer["fit_median"] == pytest.approx((80.0 + 61.5) / 2)
    # Wilson's interval of 2 of 4 by hand: 0.5 +- 1.95996 / (4 + 3.84146) * sqrt(4 * 0.25 + 3.84146 / 4)
    assert (ours["near_0.1_low"], ours["near_0.1_high"]) == pytest.approx((0.15004, 0.84996), abs=1e-5)


def test_a_diverged_run_is_a_failure():
    scored = boards.score_rows(rows(method=["x", "y"], seed=[0, 0], fit=[-1e9, 50.0]))
    assert scored.filter(pl.col("method") == "x")["gap"].to_list() == [np.inf]
    assert boards.leaderboard(scored).filter(pl.col("method") == "x")["crashed"].to_list() == [1]


def test_methods_and_records_that_are_not_there_do_not_count(table):
    absent = rows(method=["torch_ss"] * 2, status=["not installed: torch", "no data: download it"], fit=[None, None])
    both = pl.concat([table, absent])
    assert "torch_ss" not in boards.leaderboard(boards.score_rows(both))["method"].to_list()
    assert boards.missing_methods(both)["n"].to_list() == [1, 1]


def test_an_empty_table_says_what_to_do(table):
    with pytest.raises(InputError, match="qpal bench run"):
        boards.score_rows(table.clear())


def test_a_method_that_tried_a_part_of_the_tasks_is_not_ranked(table):
    part = rows(scenario=["f/a"], seed=[0], method=["easy"], fit=[99.0])
    board = boards.leaderboard(boards.score_rows(pl.concat([table, part])))
    assert board["method"].to_list() == ["ours", "peer", "easy", "from_truth"]
    assert boards.competitors(board)["method"].to_list() == ["ours", "peer"]
    (winner,) = boards.winners(board, ["ours", "easy"]).to_dicts()
    assert (winner["ours"], winner["peer"]) == ("ours", "peer")


def test_methods_that_are_told_the_structure_count_as_one():
    told = rows(
        scenario=["drawn/wiener", "drawn/wiener-long", "drawn/nlarx", "drawn/nlarx"],
        seed=[0, 0, 0, 1],
        method=["wiener", "wiener", "nlarx", "wiener"],
    )
    board = boards.leaderboard(boards.score_rows(told))
    found = {(row["family"], row["method"]): row["n"] for row in board.to_dicts()}
    assert found == {("drawn", boards.OWN): 2, ("drawn", "wiener"): 1, ("drawn-long", boards.OWN): 1}
    assert "--method nlarx --first 4 --seeds 1" in presentation.command("drawn/nlarx", boards.OWN, 4)
    assert (
        worst_to_draw(boards.score_rows(told.with_columns(fit=pl.Series([9.0, 9.0, 9.0, 9.0]))), [boards.OWN], 5) == []
    )
    worse = boards.score_rows(pl.concat([told, rows(scenario=["drawn/wiener"], method=["m"], fit=[99.0])]))
    assert worst_to_draw(worse, [boards.OWN], 5) == [("drawn/wiener", "wiener", 0)]


def test_win_and_loss_on_common_tasks_where_a_failure_loses(table):
    scored = boards.score_rows(table.filter((pl.col("method") != "peer") | (pl.col("scenario") != "f/a")))
    found = boards.compare_methods(scored, "ours", "peer", "f")
    assert (found.wins, found.ties, found.losses) == (1, 0, 1)


def test_intervals_count_where_the_model_explains_its_record():
    claims = rows(
        method="m",
        seed=[0, 1, 2],
        loss=[1.05, 1.0, 5.0],
        noise=[1.0] * 3,
        intervals=[4, 4, 4],
        held=[4, 3, 0],
        width=[0.1, 0.3, 9.0],
    )
    (row,) = boards.calibration(boards.score_rows(claims)).to_dicts()
    assert (row["n"], row["intervals"], row["held"], row["others"], row["others_held"]) == (2, 8, 7, 4, 0)
    assert row["width"] == pytest.approx(0.2)


def test_profiles_by_hand(table):
    scored = boards.score_rows(table)
    shares = boards.profile(scored, np.array([1.0, 1.05, 2.1]))
    # errors ours 9.95, 20.05, 30.5, 40; peer 20, none, none, 38.5: 40 / 38.5 = 1.039 and 20 / 9.95 = 2.01
    assert shares["ours"].to_list() == [0.75, 1.0, 1.0]
    assert shares["peer"].to_list() == [0.25, 0.25, 0.5]
    part = boards.profile(scored.filter((pl.col("method") == "ours") | (pl.col("seed") == 0)), np.array([1e9]))
    assert part.row(0)[1:] == (1.0, 0.5)  # of the tasks that the peer ran it solved half of two
    times = boards.profile(scored, np.array([1.0, 10.0]), within=1.0)
    assert times["ours"].to_list() == [0.75, 0.75]
    assert times["peer"].to_list() == [0.25, 0.25]


def test_the_worst_seed_of_each_scenario(table):
    scored = boards.score_rows(table)
    per = {(r["scenario"], r["method"]): r["worst_seed"] for r in boards.scenarios(scored).to_dicts()}
    assert (per["f/a", "ours"], per["f/b", "ours"], per["f/a", "peer"], per["f/b", "peer"]) == (1, 1, 1, 0)
    ours = boards.worst(scored, 1).filter(pl.col("method") == "ours").sort("gap")
    assert ours["gap"].to_list() == pytest.approx([0.05, 1.5])
    assert worst_to_draw(scored, ["ours"], 5) == [("f/b", "ours", 1)]


def test_words_say_who_is_first_with_numbers(table):
    scored = boards.score_rows(table)
    said = "\n".join(presentation.sentences(scored, boards.leaderboard(scored), ["ours"]))
    assert "f: ours is first. It loses 0.50 points" in said
    assert "over 4 tasks; 50 % of its fits (15 % to 85 %) are within 0.1 point" in said
    assert "ours against peer: 3 won, 0 tied and 1 lost of 4 tasks" in said
    alone = scored.filter(pl.col("method") == "ours")
    both = pl.concat([alone, alone.with_columns(family=pl.lit("g"))])
    *_, last = presentation.sentences(both, boards.leaderboard(both), ["ours"])
    assert last == "No method of others is ranked in f, g."


def test_words_say_plainly_where_a_peer_wins_and_is_faster(table):
    scored = boards.score_rows(table.with_columns(pl.col("method").replace({"ours": "peer", "peer": "ours"})))
    said = "\n".join(presentation.sentences(scored, boards.leaderboard(scored), ["ours"]))
    assert "f: peer is first, which is not of this library" in said
    assert "peer is farthest ahead on f/a, seed 1: 79.95 % against no result" in said
    assert "qpal bench run --scenario f/a --method ours.py" in said  # not of the library: a file
    assert "ours is slower than peer, whose mean gap is no larger: 7 s against 1 s" in said


def test_words_on_intervals_that_hold_too_seldom():
    few = rows(seed=list(range(50)), loss=1.0, noise=1.0, intervals=2, held=1)
    (said,) = presentation.interval_sentences(boards.score_rows(few))
    assert "m are too narrow: 50 of 100 hold" in said
    assert not presentation.interval_sentences(boards.score_rows(few.with_columns(held=pl.Series([2] * 45 + [1] * 5))))


def test_markdown_is_a_table_of_the_board(table):
    lines = markdown(boards.leaderboard(boards.score_rows(table))).splitlines()
    assert len(lines) == 5
    assert len({line.count("|") for line in lines}) == 1
    assert lines[2].startswith("| ours | 4 | 50 (15 to 85) | 75 (30 to 95) | 0.50 |")


def made(folder: Path, table: pl.DataFrame, **options) -> str:
    pages.write(folder, table, ["ours"], **options)
    return (folder / "report.html").read_text(encoding="utf-8")


def test_every_scenario_has_a_page_that_the_leaderboard_links_to(table, tmp_path):
    odd = table.with_columns(pl.col("scenario").replace({"f/b": "f/b <5 & 7>"}))
    html = made(tmp_path, odd)
    links = re.findall(r'<a href="(scenarios/[^"]+)"', html)
    assert len(links) == 2
    assert all((tmp_path / link).is_file() for link in links)
    assert "f/b &lt;5 &amp; 7&gt;" in html
    worst = (tmp_path / links[1]).read_text(encoding="utf-8")
    assert "Repeat the worst: <code><span>qpal</span> <span>bench</span> <span>run</span>" in worst


def test_two_scenarios_never_share_a_page():
    names = ["f/a-b", "f/a--b", "f/a b", "f-a/b", "f/a/b", "f--a/b", "f/a~20~b", "f.a/b", "f/a.b"]
    assert len({pages.file_name(name) for name in names}) == len(names)


def test_the_plots_are_valid_and_their_script_lies_beside_the_page(table, tmp_path):
    from plotly import graph_objects

    html = made(tmp_path, table)
    found = re.findall(r'<script type="application/json" data-for="zoom-(\w+)">(.*?)</script>', html)
    assert [name for name, _ in found] == ["errors", "times", "cost", "intervals"]
    for name, text in found:
        assert graph_objects.Figure(json.loads(text)).layout.yaxis.title.text.endswith("]"), name
        assert f'id="zoom-{name}"' in html
    assert '<script src="plotly.min.js"></script>' in html
    assert (tmp_path / "plotly.min.js").is_file()
    assert "http" not in re.sub(r'"[^"]*"|\'[^\']*\'|//.*|http-equiv', "", html)


@pytest.mark.nightly
def test_100_000_rows_make_a_page_of_less_than_10_mb(tmp_path):
    part = run_of_the_library(np.random.default_rng(0), methods=12, tasks=24)
    several = [part.with_columns(pl.col("scenario").str.replace("f", f"g{k % 7}") + f"-{k}") for k in range(350)]
    table = pl.concat(several)
    assert len(table) > 100_000
    html = made(tmp_path, table)
    assert len(html) + sum(path.stat().st_size for path in tmp_path.glob("*.js")) < 10e6


@dataclass(frozen=True)
class Doubling:
    """y = 2 u with noise that is known."""

    name: str = "made_up"
    about: str = ""

    def scenarios(self):
        return ["gain"]

    def make(self, scenario, seed):
        rng = np.random.default_rng(seed)
        u, noise = rng.normal(size=(2, 50))
        record = IOData(u, 2.0 * u + noise, Ts=0.5)
        return Task(record, {"test": record}, 5, "V", truth=Truth({"test": 2.0 * u}, 1.0), given="A gain of 2.")


@dataclass(frozen=True)
class Tripling:
    """A method that is wrong in a known way."""

    name: str = "tripling"
    about: str = ""
    status: str = "ok"

    def solve(self, task, tests, seconds, seed):
        return Outcome(self.status, {name: 3.0 * u for name, (u, _) in tests.items()})


def test_a_cell_is_drawn_again_from_its_names():
    cell = redraw(Doubling(), "gain", Tripling(), 4, 1.0)
    assert np.allclose(cell.run, 3.0 * cell.u)
    assert np.allclose(cell.clean, 2.0 * cell.u)
    assert (cell.scenario, cell.unit, cell.drop, cell.Ts) == ("made_up/gain", "V", 5, 0.5)
    assert np.array_equal(redraw(Doubling(), "gain", Tripling(), 4, 1.0).y, cell.y)
    with pytest.raises(InputError, match="crashed: E"):
        redraw(Doubling(), "gain", Tripling(status="crashed: E"), 4, 1.0)


def test_the_worst_cells_are_drawn_on_their_pages(table, tmp_path):
    asked = []

    def again(*cell):
        asked.append(cell)
        return redraw(Doubling(), "gain", Tripling(), 0, 1.0)

    html = made(tmp_path, table, redraw=again, drawn=3)
    assert asked == [("f/b", "ours", 1)]
    assert html.count("data:image/png") == 1
    assert "data:image/png" in (tmp_path / "scenarios" / "f.b.html").read_text(encoding="utf-8")
