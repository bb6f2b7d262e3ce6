"""A record in which a logger wrote -999 for no value: `qpal identify` says so first, and its remedy works."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.report.identify_answer import answer
from sysid.structures import OutputError
from sysid.workflow.identification import identify_file
from sysid.workflow.setting import Setting


@pytest.mark.parametrize(("column", "rows"), [(1, (150,)), (2, (77, 201, 202, 444))])
def test_the_model_is_refused_and_the_remedy_gives_the_plant(tmp_path: Path, column: int, rows: tuple[int, ...]):
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-4, 4, 60), 10)
    y = lfilter([0, 0.2], [1, -0.8], u) + 0.02 * rng.standard_normal(600)
    lines = [[f"{0.02 * k:.2f}", f"{u[k]:.3f}", f"{y[k]:.4f}"] for k in range(600)]

    def fitted(cell: str):
        for row in rows:
            lines[row][column] = cell
            if column == 1 and not cell:
                lines[row] = ["# removed"]
        path = tmp_path / "log.csv"
        path.write_text("time_s,u,y\n" + "\n".join(map(",".join, lines)) + "\n")
        return identify_file(path, Setting(OutputError(1, 1, 1), starts=1))

    first = answer(fitted("-999"))
    assert first.word == "poor"
    assert "-999, far outside the others, as a number that stands for none: " in first.sentence
    assert ("remove the rows" if column == 1 else "empty these cells") in first.sentence
    assert first.next.startswith(f"Next: {first.sentence.rpartition(': ')[2].rstrip('.')}; then qpal identify")
    second = fitted("")
    assert second.evaluation.judged_fit > 98.0
    assert answer(second).word == "good"
