"""An output whose sensor is slower than the log: told by a count, and read once a value where the mapping says so."""

import numpy as np
import pytest
from plants_in_time import GAIN, TAU, level_at, pole_and_gain, response, steps

from sysid.base.errors import InputError
from sysid.channels.mapping import Channel, ChannelMap, Clock
from sysid.channels.reading import read_signals
from sysid.workflow.inspection import inspect_file
from twin.cli import main

TS = 0.02


def held(path, every, phase=0, noise=0.0, step=TS, head="t_s,u_V,y_rad"):
    """Rows every 20 ms; the output is sampled in every so many of them, and written again until the next."""
    changes, levels = steps(3, 0.24, 24.0)
    t = np.arange(0.0, 24.0 - 1e-9, step)
    y = response(t, changes, levels) + noise * np.random.default_rng(0).standard_normal(len(t))
    sampled = np.maximum((np.arange(len(t)) - phase) // every * every + phase, 0)
    columns = {"t_s": t, "u_V": level_at(t, changes, levels), "y_rad": y[sampled]}
    rows = (",".join(f"{columns[name][k]:.9g}" for name in head.split(",")) for k in range(len(t)))
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def mapping(every, clock):
    return ChannelMap(clock=clock, input=(Channel(column="u_V"),), output=(Channel(column="y_rad", every=every),))


@pytest.mark.parametrize(("every", "phase"), [(2, 0), (3, 1), (4, 3), (6, 2)])
@pytest.mark.parametrize("clock", ["t_s", ""])
def test_the_way_that_is_named_gives_the_plant(every, phase, clock, tmp_path):
    path = held(tmp_path / "a.csv", every, phase, head="t_s,u_V,y_rad" if clock else "u_V,y_rad")
    own = Clock(column=clock) if clock else Clock(Ts=TS)
    first = read_signals(path, mapping(1, own))
    said = " ".join(first.notes)
    assert f"'y_rad': each value is written in {every} rows" in said
    assert f"set every = {every} in [[output]] of a mapping" in said
    record = read_signals(path, mapping(every, own))
    assert pytest.approx(every * TS) == record.Ts
    assert abs(record.N - 1200 // every) <= 1
    true = np.exp(-every * TS / TAU), GAIN
    found = pole_and_gain(record.input[0].values, record.output[0].values)
    assert found == pytest.approx(true, rel=2e-3 if 12 % every == 0 else 0.1)
    naive = pole_and_gain(first.input[0].values, first.output[0].values)
    assert abs(naive[0] - np.exp(-TS / TAU)) > 10 * abs(found[0] - true[0])


def test_info_names_it_and_the_written_map_has_the_entry(tmp_path, capsys):
    path = held(tmp_path / "a.csv", 4, noise=0.01)
    assert any("each value is written in 4 rows" in note for note in inspect_file(path).signals.notes)
    written = tmp_path / "m.toml"
    main(["info", str(path), "--write-map", str(written)])
    assert "every = 4 in [[output]]" in " ".join(capsys.readouterr().out.split())
    head, output = written.read_text().split("[[output]]")
    written.write_text(f"{head}[[output]]{output.replace('every = 1', 'every = 4', 1)}")
    assert pytest.approx(4 * TS) == read_signals(path, written).Ts


def test_what_is_not_held_is_not_said_to_be(tmp_path):
    """Each row new; a coarse encoder; a joint that rests; few values."""
    t = np.arange(600) * TS
    for y in (np.sin(t), np.round(3 * np.sin(t)), np.where(t < 6, 1.0, np.sin(t)), np.repeat(np.arange(6.0), 100)):
        path = tmp_path / "a.csv"
        path.write_text(
            "\n".join(["t_s,u_V,y_rad", *(f"{a:g},{b:g},{c:g}" for a, b, c in zip(t, np.cos(9 * t), y, strict=True))])
        )
        assert not any(
            "each value is written" in note for note in read_signals(path, mapping(1, Clock(column="t_s"))).notes
        )


def test_every_belongs_to_outputs(tmp_path):
    path = held(tmp_path / "a.csv", 4)
    wrong = ChannelMap(
        clock=Clock(column="t_s"), input=(Channel(column="u_V", every=4),), output=(Channel(column="y_rad"),)
    )
    with pytest.raises(InputError, match=r"every of \[\[input\]\] is 4, .* leave it out"):
        read_signals(path, wrong)
