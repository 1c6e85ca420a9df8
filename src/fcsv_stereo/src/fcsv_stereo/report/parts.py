# SPDX-License-Identifier: Apache-2.0
"""Pieces of HTML: tables, figures inside the page, paragraphs."""

import base64
import html
import io
from typing import Sequence

import matplotlib.pyplot as plt

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1200px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.6em; } h2 { font-size: 1.2em; margin-top: 2em; border-bottom: 1px solid #ddd; }
table { border-collapse: collapse; margin: 1em 0; } th, td { padding: .25em .7em; text-align: right; }
th { border-bottom: 2px solid #888; } td { border-bottom: 1px solid #e4e4e4; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; white-space: normal; }
figure { margin: 1em 0; } img { max-width: 100%; height: auto; } .side { display: flex; flex-wrap: wrap; gap: 1em; }
.side > * { flex: 1 1 460px; } .warning { background: #fff4d6; border-left: 4px solid #e0a800; padding: .5em 1em; }
.good { background: #e8f5e9; border-left: 4px solid #43a047; padding: .5em 1em; } .note { color: #666; }
nav a { margin-right: 1.2em; }
"""


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Cells are HTML already: escape what comes from outside."""
    top = "".join(f"<th>{h}</th>" for h in head)
    body = "".join("<tr>" + "".join(f"<td>{c}</td>" for c in row) + "</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>" if any(head) else f"<table>{body}</table>"


def side(*drawn) -> str:
    """Figures beside each other where the window is wide enough."""
    return '<div class="side">' + "".join(image(f) for f in drawn) + "</div>"


def image(figure) -> str:
    """A matplotlib figure, closed after."""
    data = io.BytesIO()
    figure.savefig(data, format="jpeg", dpi=95, bbox_inches="tight", pil_kwargs={"quality": 85})
    plt.close(figure)
    return f'<figure><img src="data:image/jpeg;base64,{base64.b64encode(data.getvalue()).decode()}"></figure>'


def note(text: str) -> str:
    """A sentence that says how a figure is to be read."""
    return f'<p class="note">{html.escape(text)}</p>'


def percent(share: float, digits: int = 0) -> str:
    """A share, or a dash where it is not known."""
    return "–" if share is None or share != share else f"{share:.{digits}%}"


def number(value, text: str) -> str:
    """``value`` in a format such as "{:.2f} m"; a dash where it is not known."""
    return "–" if value is None or value != value else text.format(value)
