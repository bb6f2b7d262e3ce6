"""The page on logs: its mapping is one, its code runs, and both read the same record."""

import re
import runpy
from pathlib import Path

import numpy as np

from sysid import read_signals
from sysid.channels.mapping_file import read_map

PAGE = (Path(__file__).parents[2] / "docs" / "logs.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    (found,) = re.findall(rf"^```{language}\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)
    return found


def test_the_mapping_and_the_code_of_the_page_read_the_same_record(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    k = np.delete(np.arange(200), 70)
    pwm, adc = 40 * (k // 20) - 200, 512 + 3 * k // 2
    rows = np.column_stack([(65_000 + 10 * k) % 2**16, pwm, adc])
    np.savetxt("rig.csv", rows, fmt="%d", delimiter=",", header="millis,pwm,adc", comments="")
    (tmp_path / "rig.toml").write_text(block("toml"), encoding="utf-8")
    (tmp_path / "page.py").write_text(block("python"), encoding="utf-8")
    data = runpy.run_path("page.py")["data"]
    signals = read_signals("rig.csv", read_map("rig.toml"))
    assert signals.counts == {"wraps": 1, "lost": 1, "filled samples": 1}
    np.testing.assert_allclose(signals.output[0].values[k], np.deg2rad(135 - adc / 1023 * 270), atol=1e-12)
    np.testing.assert_allclose(data.y[:, 0], signals.output[0].values, atol=1e-12)
    np.testing.assert_allclose(data.u[k, 0], pwm * 12 / 255, atol=1e-12)
    np.testing.assert_allclose(signals.input[0].values, data.u[:, 0], rtol=1e-5)
