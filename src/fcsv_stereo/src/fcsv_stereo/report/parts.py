# SPDX-License-Identifier: Apache-2.0
"""What a section of the report is made of: tables, figures inside the page, paragraphs. Plain text,
no HTML.

``kind`` names the macro in templates/parts.html that draws a part; it escapes what comes from
outside.
"""

import base64
import gzip
import io
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Sequence, Tuple, Union

import matplotlib.pyplot as plt


class Tone(Enum):
    """How a paragraph speaks; the value is its class in the page's style."""

    PLAIN = ""
    NOTE = "note"  # how a figure is to be read
    WARNING = "warning"
    GOOD = "good"


@dataclass(frozen=True)
class Paragraph:
    """A few sentences."""

    text: str
    tone: Tone = Tone.PLAIN
    kind: ClassVar[str] = "paragraph"


@dataclass(frozen=True)
class Heading:
    """Is the heading of a part within a section."""

    text: str
    kind: ClassVar[str] = "heading"


@dataclass(frozen=True)
class Table:
    """Rows of text under ``head``, which may be empty."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    kind: ClassVar[str] = "table"


@dataclass(frozen=True)
class Figures:
    """JPEGs in base64; beside each other where the window is wide enough, or one of the page's
    width."""

    jpegs: Tuple[str, ...]
    beside: bool
    kind: ClassVar[str] = "figures"


@dataclass(frozen=True)
class CloudView:
    """A cloud to be turned by hand: script and figure of plotly, each gzip in base64; ``shown`` of
    ``points``."""

    script: str
    figure: str
    shown: int
    points: int
    kind: ClassVar[str] = "cloud_view"


@dataclass(frozen=True)
class PixelView:
    """Picture and depth over each other: JPEGs in base64, colours and numbers of the legend, and
    what tells each pixel (``pixel_view``), each gzip in base64."""

    picture: str
    depth: str
    colours: str
    ticks: Tuple[str, ...]
    about: str
    depth_codes: str
    sigma_codes: str
    kind_codes: str
    kind: ClassVar[str] = "pixel_view"


Part = Union[Paragraph, Heading, Table, Figures, CloudView, PixelView]


def note(text: str) -> Paragraph:
    """A sentence that says how a figure is to be read."""
    return Paragraph(text, Tone.NOTE)


def side(*drawn) -> Figures:
    """Figures of matplotlib beside each other."""
    return Figures(tuple(map(_jpeg, drawn)), True)


def image(figure) -> Figures:
    """One figure of matplotlib."""
    return Figures((_jpeg(figure),), False)


def percent(share: float, digits: int = 0) -> str:
    """A share, or a dash where it is not known."""
    return "–" if share is None or share != share else f"{share:.{digits}%}"


def number(value, text: str) -> str:
    """``value`` in a format such as "{:.2f} m"; a dash where it is not known."""
    return "–" if value is None or value != value else text.format(value)


def packed(data: bytes) -> str:
    """gzip in base64, the same for the same bytes; browsers unpack it (DecompressionStream)."""
    return base64.b64encode(gzip.compress(data, 6, mtime=0)).decode()


def _jpeg(figure) -> str:
    """The figure, closed after."""
    data = io.BytesIO()
    figure.savefig(data, format="jpeg", dpi=95, bbox_inches="tight", pil_kwargs={"quality": 85})
    plt.close(figure)
    return base64.b64encode(data.getvalue()).decode()
