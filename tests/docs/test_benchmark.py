"""docs/benchmark.md: its numbers are those of the code, and its measures are all there."""

from pathlib import Path

from sysid.bench import leaderboard, measures, regression

PAGE = " ".join((Path(__file__).parents[2] / "docs" / "benchmark.md").read_text(encoding="utf-8").split())


def test_numbers_are_those_of_the_code():
    expected = (
        f"larger by more than {100 * measures.SAME_LOSS:g} %",
        f"lower by more than {measures.SAME_FIT:g} point though",
        f"wider by more than {100 * measures.SAME_WIDTH:g} %",
        f"than {100 * regression.FLIPPED:g} % of flips explain (binomial test; over all measures and methods "
        f"{100 * regression.ALARM:g} %",
        f"(sign test, {100 * regression.SIGN:g} %)",
        f"at most {leaderboard.EXPLAINED:g} times the variance of the noise",
        f"less than {100 * leaderboard.ENOUGH:g} % of a family's tasks",
        f"each gap counted as {leaderboard.CAP:g} points at most",
        f"Within {leaderboard.NEAR[0]:g} point, within {leaderboard.NEAR[1]:g} point",
        f"a difference within {leaderboard.NEAR[0]:g} point is a tie",
    )
    assert [text for text in expected if text not in PAGE] == []


def test_every_room_that_is_named_is_in_the_table_of_measures():
    table = PAGE.partition("| a pair is worse if | room |")[2].partition("Unchanged code")[0]
    for room in measures.PLACES:
        assert room.replace("selection", "structure search") in table


def test_places_to_look_at_exist():
    root = Path(__file__).parents[2]
    for places in measures.PLACES.values():
        named = [word.strip(",") for word in places.split() if word.startswith("sysid/")]
        assert named
        assert all((root / name).exists() for name in named)
