"""What is known after some experiments, each of which tells some values."""

from types import SimpleNamespace

from twin.rig.auto import ASKED, Campaign, Round


def value(name, low, high):
    """A stand-in of a joint's value, with its interval or without one."""
    return SimpleNamespace(name=name, low=low, high=high, determined=low is not None)


def test_a_value_is_that_of_the_record_that_tells_it_most_narrowly():
    first, second = ASKED[:2]
    rounds = [
        Round("sweep", None, (value(first, 1.0, 2.0), value(second, None, None), value("other", 0.0, 1.0)), 90.0),
        Round("design", None, (value(first, 0.0, 4.0), value(second, 3.0, 4.0)), 90.0),
    ]
    campaign = Campaign("thigh", tuple(rounds), 100.0)
    assert campaign.values_after(1)[first].high == 2.0
    known = campaign.values_after(2)
    assert (known[first].high, known[second].high) == (2.0, 4.0)
    assert "other" not in known
    assert campaign.open == list(ASKED[2:])
