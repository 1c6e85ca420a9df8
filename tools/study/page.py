# SPDX-License-Identifier: Apache-2.0
"""What a section of the study writes: Markdown, tables, and pictures of modest size."""

import io
import os
from pathlib import Path
from typing import List, Optional, Sequence

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm
from PIL import Image

from fcsv_stereo.report.figures import round_numbers

_NONE = "#20242b"


class Page:
    """Markdown lines, and the folder of their pictures."""

    def __init__(self, path: Path, pictures: Path):
        self.path, self.pictures = path, pictures
        self.lines: List[str] = []
        pictures.mkdir(parents=True, exist_ok=True)

    def text(self, *paragraphs: str) -> None:
        """Each a paragraph of its own."""
        for p in paragraphs:
            self.lines += [p, ""]

    def table(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        self.lines += [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
        self.lines += [f"| {' | '.join(row)} |" for row in rows] + [""]
        for row in rows:
            print("   ", " | ".join(row), flush=True)

    def figure(self, figure, name: str, words: str) -> None:
        """Saved with a palette of 128 colours: a quarter of the size, and no difference to the
        eye."""
        data = io.BytesIO()
        figure.savefig(data, format="png", dpi=72, bbox_inches="tight")
        plt.close(figure)
        file = self.pictures / f"{name}.png"
        Image.open(data).convert("RGB").quantize(128).save(file, optimize=True)
        relative = Path(os.path.relpath(file.resolve(), self.path.resolve().parent))
        self.lines += [f"![{words}]({relative.as_posix()})", ""]

    def write(self) -> None:
        self.path.write_text("\n".join(self.lines).rstrip() + "\n")


def panels(
    images: Sequence[np.ndarray],
    titles: Sequence[str],
    columns: int,
    limits=(8.0, 480.0),
    label="depth (m)",
):
    """Pictures (H,W,3) as they are, depth (H,W) in colour over ``limits`` (logarithmic), dark where
    there is none."""
    rows = int(np.ceil(len(images) / columns))
    size = (3.5 * columns, 2.8 * rows)
    figure, axes = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    colors = plt.get_cmap("turbo_r").with_extremes(bad=_NONE)
    drawn = None
    for ax in axes.ravel():
        ax.axis("off")
    for ax, image, title in zip(axes.ravel(), images, titles):
        if image.ndim == 3:
            ax.imshow(image)
        else:
            drawn = ax.imshow(image, cmap=colors, norm=LogNorm(*limits))
        ax.set_title(title, fontsize=9)
    if drawn is not None:
        round_numbers(figure.colorbar(drawn, ax=axes, label=label, shrink=0.7, pad=0.01).ax.yaxis)
    return figure


def percent(share: Optional[float]) -> str:
    return "–" if share is None or not np.isfinite(share) else f"{share:.1%}"


def metres(value: Optional[float]) -> str:
    return "–" if value is None or not np.isfinite(value) else f"{value:.2f} m"
