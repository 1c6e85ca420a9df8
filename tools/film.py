#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Films a demo on a screen in memory: the operator's window while it flies, rviz while the flight is
played back with its map, and the report.

    python tools/film.py [--out FILE] [--seconds 90] [--keep FOLDER] [DEMO ARGUMENTS ...]

It flies `rosrun fcsv_sim demo` with the arguments that follow, seed 1 without any. The film shows
the flight as much faster as it takes to fit. The report is drawn by chromium; without that the film
ends with rviz, and says so. FILE is docs/pictures/film.gif, README's film.
"""

import argparse
import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Iterator, List, Optional, Tuple

from PIL import Image
from tqdm import tqdm
from Xlib import X, display
from Xlib.error import XError

_ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(_ROOT / "tests"))

from support.screen import Screen  # noqa: E402

_SCREEN_PX = (1366, 768)
_FILM_PX = (1000, 562)
_FRAMES_S = 2.0  # frames of the film a second
_GRAB_S = 1.0  # between two pictures of the screen
_RVIZ_SHARE, _REPORT_SHARE = 0.2, 0.2  # of the film
_PLAYED_S = 40.0  # of the playback
_REPORT_PX = (1100, 5200)
_COLOURS = 64
_MOST_BYTES = 5_000_000
_LIMIT_S, _BROWSER_S = 3000.0, 300.0
# what the demo says once all have landed, and once its map is made
_LANDED, _OVER = "DONE: ", "report: "


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 1 where the demo fails, or the film is too large."""
    parser = argparse.ArgumentParser(prog="film", description=__doc__.split("\n\n")[0])
    parser.add_argument("--out", type=Path, default=_ROOT / "docs/pictures/film.gif")
    parser.add_argument("--seconds", type=float, default=90.0, help="length of the film")
    parser.add_argument(
        "--keep",
        type=Path,
        help="folder for the demo and the pictures: what is in it already is not flown or played "
        "again; default: one that is removed",
    )
    args, demo = parser.parse_known_args(argv)
    folder = args.keep or Path(tempfile.mkdtemp(prefix="film"))
    try:
        flown = _fly(folder, demo or ["--seed", "1"])
        if not flown:
            return 1
        played = _play(folder)
        return _compose(flown, played, _report_pictures(folder), args.seconds, args.out)
    finally:
        if args.keep is None:
            shutil.rmtree(folder, ignore_errors=True)


# ---- the flight ----------------------------------------------------------------------------------


def _fly(folder: Path, demo: List[str]) -> List[Path]:
    """Pictures of the window, one a second, from its start until the vehicles have landed; none
    where the demo failed."""
    command = ["rosrun", "fcsv_sim", "demo", "--rviz", "0", "--out", str(folder / "demo"), *demo]
    log, pictures = folder / "demo.log", folder / "flight"
    if not log.exists() or _OVER not in log.read_text(errors="replace"):
        with _filmed(folder, command, log) as film:
            film.until(_LANDED, _LIMIT_S, "filming the flight", pictures)
            film.until(_OVER, _LIMIT_S, "mapping")
    if _OVER in log.read_text(errors="replace"):
        return sorted(pictures.glob("*.png"))
    print(f"film: the demo did not come to its report: {log}", file=sys.stderr)
    return []


def _play(folder: Path) -> List[Path]:
    """Pictures of rviz while the flight is played back with its map."""
    command = [str(folder / "demo" / "play"), "console:=false", "rate:=2"]
    pictures = folder / "rviz"
    if not pictures.exists():
        with _filmed(folder, command, folder / "play.log") as film:
            film.until("", _PLAYED_S, "filming rviz", pictures)
    return sorted(pictures.glob("*.png"))


class _Film:
    """A process on a screen of its own, of which pictures are taken."""

    def __init__(self, process: subprocess.Popen, log: Path, server: display.Display):
        self._process, self._log, self._server = process, log, server

    def until(self, words: str, limit_s: float, what: str, pictures: Optional[Path] = None) -> None:
        """Waits until the process says ``words`` or ends; a picture a second goes to the folder
        ``pictures``."""
        if pictures is not None:
            pictures.mkdir(exist_ok=True)
        for k in tqdm(range(int(limit_s / _GRAB_S)), what, unit=" s", disable=None):
            ended = self._process.poll() is not None
            if ended or words and words in self._log.read_text(errors="replace"):
                return
            if _arranged(self._server) and pictures is not None:
                _grab(self._server, pictures / f"{k:05d}.png")
            time.sleep(_GRAB_S)


@contextlib.contextmanager
def _filmed(folder: Path, command: List[str], log: Path) -> Iterator[_Film]:
    folder.mkdir(parents=True, exist_ok=True)
    screen = Screen(folder, f"{_SCREEN_PX[0]}x{_SCREEN_PX[1]}x24")
    env = {**os.environ, "DISPLAY": screen.name, "QT_QPA_PLATFORM": "xcb", "PYTHONUNBUFFERED": "1"}
    with open(log, "wb") as out:
        process = subprocess.Popen(
            command,
            stdout=out,
            stderr=out,
            stdin=subprocess.DEVNULL,
            env=env,
            start_new_session=True,
        )
    server = display.Display(screen.name)
    try:
        yield _Film(process, log, server)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(120.0)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
        server.close()
        screen.close()


def _arranged(server: display.Display) -> bool:
    """Whether a window is there; it fills the screen, as by a window manager."""
    there = False
    for window in server.screen().root.query_tree().children:
        try:
            name = window.get_wm_name() or ""
            shown = window.get_attributes().map_state == X.IsViewable
            if not shown or not isinstance(name, str) or not name:
                continue
            there = True
            if "rviz" in name.lower() or "fcsv" in name.lower():
                window.configure(x=0, y=0, width=_SCREEN_PX[0], height=_SCREEN_PX[1])
        except XError:
            continue  # it was closed meanwhile
    server.sync()
    return there


def _grab(server: display.Display, path: Path) -> None:
    width, height = _SCREEN_PX
    raw = server.screen().root.get_image(0, 0, width, height, X.ZPixmap, 0xFFFFFFFF)
    Image.frombytes("RGB", (width, height), raw.data, "raw", "BGRX").resize(
        _FILM_PX, Image.LANCZOS
    ).save(path)


# ---- the report and the film ---------------------------------------------------------------------


def _report_pictures(folder: Path) -> List[Image.Image]:
    """The report, scrolled from its top to its end."""
    browser = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if browser is None:
        print("film: without the report: chromium is not installed", file=sys.stderr)
        return []
    whole, page = folder / "report.png", folder / "demo" / "map" / "report.html"
    size = f"--window-size={_REPORT_PX[0]},{_REPORT_PX[1]}"
    command = [
        browser,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--virtual-time-budget=8000",
        size,
    ]
    command += [f"--screenshot={whole}", page.as_uri()]
    try:
        subprocess.run(command, check=True, capture_output=True, timeout=_BROWSER_S)
    except subprocess.SubprocessError as error:
        print(f"film: without the report: {error}", file=sys.stderr)
        return []
    return scrolled(Image.open(whole).convert("RGB"), _FILM_PX)


def scrolled(page: Image.Image, size: Tuple[int, int], step: float = 0.25) -> List[Image.Image]:
    """Views of ``size`` of a page that is scrolled down by ``step`` of a view each; the page fills
    the view's width."""
    height = round(page.height * size[0] / page.width)
    page = page.resize((size[0], max(height, size[1])), Image.LANCZOS)
    last = page.height - size[1]
    tops = [min(last, round(k * step * size[1])) for k in range(int(last / (step * size[1])) + 2)]
    return [page.crop((0, top, size[0], top + size[1])) for top in dict.fromkeys(tops)]


def evenly(pictures: list, count: int) -> list:
    """So many of ``pictures``, evenly over their order.

    >>> evenly([0, 1, 2, 3, 4, 5], 3), evenly([0, 1], 4)
    ([0, 2, 5], [0, 0, 1, 1])
    """
    if not pictures or count < 1:
        return []
    last = len(pictures) - 1
    return [pictures[round(k * last / max(count - 1, 1))] for k in range(count)]


def _compose(
    flown: List[Path], played: List[Path], report: List[Image.Image], seconds: float, out: Path
) -> int:
    frames = round(seconds * _FRAMES_S)
    of_report = round(_REPORT_SHARE * frames) if report else 0
    of_rviz = round(_RVIZ_SHARE * frames) if played else 0
    of_flight = evenly(flown, frames - of_report - of_rviz)
    pictures = [Image.open(p).convert("RGB") for p in of_flight + evenly(played, of_rviz)]
    pictures += evenly(report, of_report)
    palette = _palette(pictures)
    small = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    out.parent.mkdir(parents=True, exist_ok=True)
    small[0].save(
        out,
        save_all=True,
        append_images=small[1:],
        duration=round(1000 / _FRAMES_S),
        loop=0,
        optimize=True,
    )
    size = out.stat().st_size
    print(f"wrote {out}: {len(small)} pictures, {seconds:.0f} s, {size / 1e6:.1f} MB")
    if size > _MOST_BYTES:
        print(
            f"film: larger than {_MOST_BYTES / 1e6:.0f} MB: give fewer --seconds", file=sys.stderr
        )
        return 1
    return 0


def _palette(pictures: List[Image.Image]) -> Image.Image:
    """One for all, so that only what changes is stored."""
    some = evenly(pictures, 12)
    sheet = Image.new("RGB", (some[0].width, sum(p.height for p in some)))
    top = 0
    for p in some:
        sheet.paste(p, (0, top))
        top += p.height
    return sheet.quantize(_COLOURS, Image.Quantize.MEDIANCUT)


if __name__ == "__main__":
    sys.exit(main())
