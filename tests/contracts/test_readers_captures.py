"""What the reader of serial captures takes out of every form that a microcontroller prints."""

import numpy as np
import pytest
from few_rows import columns
from often import often

from sysid import read
from sysid.base.errors import InputError
from sysid.formats import read_table

FORMS = {
    "commas": ("{0},{1},{2}", "ms,adc,pwm"),
    "semicolons": ("{0}; {1}; {2}", "# ms;adc;pwm"),
    "blanks": ("{0} {1} {2}", "ms adc pwm"),
    "pairs": ("ms={0} adc={1} pwm={2}", ""),
    "pairs with colons": ("ms: {0}, adc: {1}, pwm: {2}", "hello"),
    "stamped by a terminal": ("12:00:01.234 -> {0},{1},{2}", "ms,adc,pwm"),
}


@pytest.mark.parametrize("suffix", [".log", ".txt"])
@pytest.mark.parametrize(("form", "names"), FORMS.values(), ids=FORMS)
def test_captures_of_every_form(form, names, suffix, tmp_path):
    samples = [(5 * k, 500 + k % 7, (-1) ** (k // 9) * 80) for k in range(60)]
    lines = ["rst:0x1 (POWERON_RESET)", names, *(form.format(*sample) for sample in samples)]
    lines[40] = lines[40][:4]
    path = tmp_path / f"a{suffix}"
    path.write_text("\r\n".join(lines) + "\r\n", newline="")
    table = read_table(path)
    assert table.names == ("ms", "adc", "pwm")
    assert np.column_stack(table.columns).tolist() == [list(each) for k, each in enumerate(samples) if k != 38]
    assert list(table.rows[0]) == [k + 3 for k in range(60) if k != 38]
    assert any("1 garbled line (row 41)" in note for note in table.notes)


def test_pairs_alone_called_txt_are_a_capture(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("t=1 adc=512\nt=2 adc=513\nt=3 adc=511\nt=4 adc=512\nt=5 adc=510\n")
    assert columns(read_table(path)) == {"t": [1, 2, 3, 4, 5], "adc": [512, 513, 511, 512, 510]}


PAIRED = [f"ms:{10 * k} u:{k % 9} y:{500 + k % 7}" for k in range(200)]


@pytest.mark.parametrize("suffix", [".log", ".txt"])
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("count", [1, 7, 20, 23, 60, 99])
def test_lines_that_lost_their_sensor_at_an_end_of_the_file_count_as_everywhere(suffix, first, count, tmp_path):
    lost = range(count) if first else range(200 - count, 200)
    lines = [f"{line.rpartition(':')[0]}:---" if k in lost else line for k, line in enumerate(PAIRED)]
    path = tmp_path / f"a{suffix}"
    path.write_text("\n".join(lines) + "\n")
    if count > 20:
        with pytest.raises(InputError, match=rf"row {lost[0] + 1}: .* {count} of 200 lines .* more than a tenth"):
            read_table(path)
        return
    table = read_table(path)
    assert table.columns[0].tolist() == [10 * k for k in range(200) if k not in lost]
    (note,) = (note for note in table.notes if "garbled" in note)
    assert [int(row) for row in note.partition("(row")[2].strip("s )").split(",")] == [k + 1 for k in lost]


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("count", [3, 19, 80])
def test_a_column_that_begins_or_ends_within_the_file_is_told_and_never_half_a_record(first, count, tmp_path):
    lines = [f"{10 * k},{k % 9},{500 + k % 7}" for k in range(200)]
    more = range(count) if first else range(200 - count, 200)
    text = "ms,u,y\n" + "".join(f"{line},1\n" if k in more else f"{line}\n" for k, line in enumerate(lines))
    for suffix, said in ((".log", "the form of the samples changes"), (".txt", "found 4 cells"), (".csv", "4 cells")):
        path = tmp_path / f"a{suffix}"
        path.write_text(text)
        with pytest.raises(InputError, match=rf"row {more[0] + 2}\b.*{said}"):
            read_table(path)


def test_text_below_the_last_sample_is_told(tmp_path):
    path = tmp_path / "a.log"
    path.write_text("\n".join([*PAIRED, "halted", "", "bye"]) + "\n")
    table = read_table(path)
    assert len(table.columns[0]) == 200
    assert "left out 2 lines (rows 201, 203) of text below the last sample" in table.notes
    path.write_text("\n".join([*PAIRED, *["bye"] * 60]) + "\n")
    with pytest.raises(InputError, match=r"row 201: .* 60 of 260 lines"):
        read_table(path)


ABOVE = {"a version": "2,1", "a calibration": "512.0,1.5", "two lines": "51.0,0.3\n50.0,0.1", "three": "1,2\n3,4\n5,6"}


@pytest.mark.parametrize("above", ABOVE.values(), ids=ABOVE)
@pytest.mark.parametrize("end", ["", ","])
def test_numbers_above_the_names_are_no_samples_and_hide_no_names(above, end, tmp_path):
    """The names were lost, and with them which column is the input and the unit of the angle."""
    rng = np.random.default_rng(5)
    u, y = rng.integers(-120, 121, 60) / 10, rng.integers(100, 400, 60) / 10
    path = tmp_path / "a.log"
    rows = [f"{b},{a}{end}" for a, b in zip(u, y, strict=True)]
    path.write_text("\n".join([above, f"angle_deg,voltage_V{end}", *rows]) + "\n")
    record = read(path, Ts=0.01)
    np.testing.assert_array_equal(record.u[:, 0], u)
    np.testing.assert_allclose(record.y[:, 0], np.radians(y), rtol=1e-12)


def test_names_with_blanks_between_tabs_are_the_names(tmp_path):
    path = tmp_path / "a.log"
    rows = [f"{k % 7}.0\t{k % 5}.0" for k in range(60)]
    path.write_text("\n".join(["angle [deg]\tvoltage [V]", *rows]) + "\n")
    record = read(path, Ts=0.01)
    np.testing.assert_array_equal(record.u[:, 0], np.arange(60) % 5)
    np.testing.assert_allclose(record.y[:, 0], np.radians(np.arange(60) % 7), rtol=1e-12)


@pytest.mark.parametrize("seed", often(6, 2))
def test_garbled_captures_lose_no_good_line_and_few_bad_ones_pass(seed, tmp_path):
    """2 % of the lines garbled in four ways: every good line comes back as it was, at most 8 % of the bad ones pass.

    Those are the ones that no rule can see, such as a changed sign where the level changes too.
    """
    rng = np.random.default_rng(seed)
    n = 4000
    t = 12000 + np.cumsum(rng.integers(9, 12, n))
    adc = np.round(512 + 300 * np.sin(np.arange(n) / 50) + rng.normal(0, 2, n)).astype(int)
    pwm = np.repeat(rng.integers(-255, 256, n // 20), 20)
    whole = [f"{a},{b},{c}" for a, b, c in zip(t, adc, pwm, strict=True)]
    out, right, k = ["boot", "t_ms,adc,pwm"], [None, None], 0
    while k < n:
        line = whole[k]
        bad = rng.random() < 0.02 and k + 1 < n
        if bad:
            i, way = rng.integers(0, len(line)), rng.integers(0, 4)
            after = whole[k + 1]
            line = (
                line[:i] + line[i + 1 :],
                line[:i] + chr(rng.integers(128, 255)) + line[i + 1 :],
                line[:i] + after[rng.integers(0, len(after)) :],
                line + after,
            )[way]
            k += way > 1
        out.append(line)
        right.append(None if bad else (t[k], adc[k], pwm[k]))
        k += 1
    path = tmp_path / "a.log"
    path.write_text("\n".join(out) + "\n", encoding="latin-1")
    table = read_table(path)
    found = dict(zip(table.rows[0], np.column_stack(table.columns).tolist(), strict=True))
    good = {row: list(each) for row, each in enumerate(right, 1) if each}
    assert {row: found.get(row) for row in good} == good
    passed = [row for row in found if row not in good]
    assert len(passed) <= 0.08 * sum(each is None for each in right[2:])
