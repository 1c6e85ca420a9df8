# SPDX-License-Identifier: Apache-2.0
"""What all benches share: a grid of cases is measured, row by row, and becomes a table, which stands
in a page of docs/lab between two marks.

    for case, row in measured(flight, grid(world=WORLDS, seed=(1, 2))):
        print(line(row))
"""

import os
import platform
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, Iterator, List, Sequence, Tuple

import numpy as np
from scipy.stats import chi2

ROOT = Path(__file__).resolve().parents[1]
LAB = ROOT / "docs" / "lab"
_END = "<!-- end of table -->"

#: Arguments of what is measured, by name.
Case = Dict[str, Any]


def grid(**axes: Iterable[Any]) -> List[Case]:
    """Every combination of the axes' values; the last axis changes first.

    >>> grid(world=["street"], seed=[1, 2])
    [{'world': 'street', 'seed': 1}, {'world': 'street', 'seed': 2}]
    """
    return [dict(zip(axes, values)) for values in product(*axes.values())]


def measured(
    measure: Callable[..., Any], cases: Sequence[Case], jobs: int = 1
) -> Iterator[Tuple[Case, Any]]:
    """Each case with what ``measure(**case)`` returns, in the cases' order, as soon as it is there.

    ``jobs``: processes; with more than one, ``measure`` is a function of a module.
    """
    if jobs == 1:
        for case in cases:
            yield case, measure(**case)
        return
    with ProcessPoolExecutor(jobs) as pool:
        futures = [pool.submit(measure, **case) for case in cases]
        for case, future in zip(cases, futures):
            yield case, future.result()


def line(cells: Sequence[Any]) -> str:
    """A row of a table in Markdown.

    >>> line(["street", 1, "3.2 %"])
    '| street | 1 | 3.2 % |'
    """
    return f"| {' | '.join(map(str, cells))} |"


def head(titles: Sequence[str]) -> str:
    """The first two lines of a table in Markdown.

    >>> print(head(["world", "seed"]))
    | world | seed |
    |---|---|
    """
    return f"{line(titles)}\n|{'---|' * len(titles)}"


def table(titles: Sequence[str], rows: Iterable[Sequence[Any]]) -> List[str]:
    """The lines of a whole table in Markdown."""
    return [*head(titles).split("\n"), *map(line, rows)]


def show(titles: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Prints a table, each row as soon as it is measured."""
    print(head(titles), flush=True)
    for row in rows:
        print(line(row), flush=True)


def rms(values: Sequence[float]) -> float:
    """The root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def consistency_band(number: int, degrees: int = 6) -> Tuple[float, float]:
    """The 95 % band in which the mean of ``number`` normalised squared errors of ``degrees`` degrees
    of freedom lies, per degree of freedom, if the stated covariances are right (Bar-Shalom 2001,
    section 5.4)."""
    n = degrees * number
    low, high = chi2.ppf([0.025, 0.975], n) / n
    return float(low), float(high)


def provenance(command: str) -> str:
    """The line below a table: date, machine and command."""
    machine = f"{platform.machine()}, {os.cpu_count()} cores, shared"
    return (
        f"{time.strftime('%Y-%m-%d')}, {machine}, Python {platform.python_version()}: `{command}`."
    )


def kept(page: Path, script: str) -> str:
    """What stands between a script's marks in a page. ValueError where the page lacks them."""
    _, begin, rest = page.read_text().partition(_begin(script))
    text, end, _ = rest.partition(_END)
    if not (begin and end):
        raise ValueError(f"{page}: lacks the marks '{_begin(script)}' and '{_END}' of its table")
    return text.strip("\n")


def write(page: Path, script: str, lines: Sequence[str]) -> None:
    """Puts lines between a script's marks in a page. ValueError where the page lacks them."""
    kept(page, script)
    before, begin, rest = page.read_text().partition(_begin(script))
    text = "\n".join(lines).strip("\n")
    page.write_text(f"{before}{begin}\n\n{text}\n\n{_END}{rest.partition(_END)[2]}")
    print(f"wrote {page}")


def _begin(script: str) -> str:
    return f"<!-- table: tools/{script} -->"


def picture(
    path: Path,
    series: Dict[str, Tuple[Sequence[float], Sequence[float]]],
    x_title: str,
    y_title: str,
) -> None:
    """A picture of curves: x and y of each series by its name, both axes from zero."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.0))
    for name, (x, y) in series.items():
        axes.plot(x, y, "o-", label=name)
    axes.set(xlabel=x_title, ylabel=y_title)
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
    plt.close(figure)
