"""What the reader of serial captures takes out of every form that a microcontroller prints."""

import numpy as np
import pytest
from few_rows import columns
from often import often

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
