"""Rows -> table. A pure function of the results file."""

import numpy as np

HEAD = (
    "plant", "structure", "starts", "seeds", "gap < 0.1", "median gap", "worst gap", "pole RMSE / CRB",
    "median s", "worst s", "median iterations", "converged",
)  # fmt: skip


def table(rows: list[dict[str, str]]) -> str:
    """Markdown: for each plant, structure and number of starts, how close the fits are to the truth and how fast."""
    groups: dict[tuple[str, str, int], list[dict[str, str]]] = {}
    for row in rows:
        groups.setdefault((row["plant"], row["structure"], int(row["starts"])), []).append(row)
    lines = ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    order = sorted(groups, key=lambda k: (k[0], k[1] != "own", k[2]))
    return "\n".join([*lines, *("| " + " | ".join(_cells(k, groups[k])) + " |" for k in order)])


def _cells(key: tuple[str, str, int], rows: list[dict[str, str]]) -> list[str]:
    gap = np.array([float(r["gap"]) for r in rows])
    seconds = np.array([float(r["seconds"]) for r in rows])
    errors = np.array([[float(e) for e in r["pole_errors_crb"].split(";")] for r in rows])
    rmse = np.sqrt(np.mean(errors**2, axis=0))
    return [
        *(str(k) for k in key),
        str(len(rows)),
        f"{100 * np.mean(gap < 0.1):.0f} %",
        f"{np.median(gap):.4f}",
        f"{gap.max():.3f}",
        ", ".join(f"{r:.2f}" for r in rmse),
        f"{np.median(seconds):.3f}",
        f"{seconds.max():.2f}",
        f"{np.median([int(r['iterations']) for r in rows]):.0f}",
        f"{100 * np.mean([r['converged'] == '1' for r in rows]):.0f} %",
    ]
