"""Words in hexadecimal: read where 0x says so, else by the mapping entry that the refusal names."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.base.errors import InputError
from sysid.channels.guess import guess
from sysid.channels.mapping_file import map_text, read_map
from sysid.channels.reading import read_signals
from sysid.formats import read_table

RNG = np.random.default_rng(3)
U = np.repeat(RNG.integers(0, 4000, 40), 10)
Y = np.round(lfilter([0.0, 0.2], [1.0, -0.9], U)).astype(int)
T = 0.02 * np.arange(len(U))


def write(path, form, u=U, y=Y):
    rows = (f"{t:.2f},{form(a)},{form(b)}" for t, a, b in zip(T, u, y, strict=True))
    path.write_text("\n".join(["t,u,y", *rows]) + "\n")
    return path


def check(record, y=Y):
    np.testing.assert_array_equal(record.input[0].values, U)
    np.testing.assert_array_equal(record.output[0].values, y)


@pytest.mark.parametrize("form", ["0x{:04X}", "0X{:x}", " 0x{:08x}"])
def test_a_prefix_says_that_words_are_hexadecimal(form, tmp_path):
    record = read_signals(write(tmp_path / "log.csv", form.format))
    check(record)
    assert any(note.startswith("read hexadecimal words in 'u', 'y', as in ") for note in record.notes)


def test_words_in_twos_complement_get_their_sign(tmp_path):
    y = Y - int(np.median(Y))
    record = read_signals(write(tmp_path / "log.csv", lambda x: f"0x{x & 0xFFFF:04X}", y=y))
    check(record, y)


@pytest.mark.parametrize("form", ["{:04X}", "{:x}", "{:X}h"])
def test_words_without_a_prefix_are_read_by_the_entry_that_the_refusal_names(form, tmp_path):
    """The map is what `info --write-map` writes, with the choices that its comments offer."""
    path = write(tmp_path / "log.csv", form.format)
    with pytest.raises(InputError, match="hexadecimal word: set base = 16 for its channel in a mapping"):
        read_signals(path)
    doubtful = guess(path)
    assert doubtful.remarks["input.column"].endswith("u (base = 16), y (base = 16)")
    head, first, second = map_text(doubtful.mapping).replace("base = 10", "base = 16").split("[[")
    parts = (head, first.replace('column = ""', 'column = "u"'), second.replace('column = ""', 'column = "y"'))
    (tmp_path / "map.toml").write_text("[[".join(parts))
    check(read_signals(path, read_map(tmp_path / "map.toml")))


def test_a_column_of_digits_beside_words_is_told_and_read_as_words_where_the_map_says_so(tmp_path):
    """0100 has no letter: nothing but the mapping tells it from a decimal number."""
    path, coarse = tmp_path / "log.csv", U // 1000 * 256
    write(path, "{:04X}".format, u=coarse)
    maps = [tmp_path / "one.toml", tmp_path / "both.toml"]
    for file, base in zip(maps, (10, 16), strict=True):
        file.write_text(
            f'[clock]\ncolumn = "t"\n[[input]]\ncolumn = "u"\nbase = {base}\n[[output]]\ncolumn = "y"\nbase = 16\n'
        )
    one, both = (read_signals(path, read_map(file)) for file in maps)
    assert any("'u' stands beside hexadecimal words, but has digits alone" in note for note in one.notes)
    np.testing.assert_array_equal(one.input[0].values, U // 1000 * 100)
    np.testing.assert_array_equal(both.input[0].values, coarse)
    assert not any("stands beside" in note for note in both.notes)


def test_the_cell_that_is_no_word_is_named(tmp_path):
    path = write(tmp_path / "log.csv", "0x{:04X}".format)
    text = path.read_text().splitlines()
    text[7] = text[7].replace(",0x", ",0y", 1)
    path.write_text("\n".join(text))
    with pytest.raises(InputError, match="set base = 16"):
        read_signals(path)
    (tmp_path / "map.toml").write_text(
        '[clock]\ncolumn = "t"\n[[input]]\ncolumn = "u"\nbase = 16\n[[output]]\ncolumn = "y"\n'
    )
    with pytest.raises(InputError, match=r"row 8, column 'u': found '0y0.*', which is no hexadecimal word; correct"):
        read_signals(path, read_map(tmp_path / "map.toml"))


def test_a_word_that_0x_gave_away_is_not_read_twice_and_names_stay_names(tmp_path):
    path = write(tmp_path / "log.csv", "0x{:04X}".format)
    (tmp_path / "map.toml").write_text(
        '[clock]\ncolumn = "t"\n[[input]]\ncolumn = "u"\nbase = 16\n[[output]]\ncolumn = "y"\n'
    )
    check(read_signals(path, read_map(tmp_path / "map.toml")))
    (tmp_path / "ids.csv").write_text(
        "t,u,y,part\n" + "".join(f"{0.1 * k:.1f},{k % 3},{k % 5},A{k}\n" for k in range(50))
    )
    assert read_table(tmp_path / "ids.csv").hexadecimal == frozenset()
    assert read_signals(tmp_path / "ids.csv").input[0].column == "u"
