"""The look of all figures, and their files: the same figure gives the same bytes."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeAlias

import matplotlib
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from skillctl.errors import printable

Drawing: TypeAlias = Figure  # for rooms that do not import Matplotlib
Line: TypeAlias = "dict[str, Any]"  # how a line looks, as Matplotlib's keywords

# Okabe and Ito's colours, which colour-blind readers can distinguish. Demonstrations and motions differ in
# lightness and dash as well, for prints without colours.
DEMONSTRATION, MOTION, LEFT_OUT, WITNESS = "#D55E00", "#0072B2", "#8E4B7B", "#D55E00"
GROWING = "#F4B79B"  # where V grows
FLOW, QUIET, INK, DENSITY = "#B4B4B4", "#8C8C8C", "#1A1A1A", "#00785A"
PARTS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#8C6D31", "#0072B2", "#D55E00", "#777777")

DARKER = 0.7  # share of a part's colour that its motions keep

HALO = [withStroke(linewidth=2.0, foreground="white")]  # numbers stay readable on lines
OUTLINED = [withStroke(linewidth=1.7, foreground=INK)]  # white lines are lost on yellow

DEMONSTRATED: Line = {"color": DEMONSTRATION, "lw": 1.3, "ls": (0, (4, 1.6)), "zorder": 4.0}
MOVED: Line = {"color": MOTION, "lw": 1.2, "ls": "-", "zorder": 5.0}
HELD: Line = {"color": LEFT_OUT, "lw": 1.2, "ls": (0, (1, 1.2)), "zorder": 5.5}
STARTED: Line = {
    "ls": "", "marker": "o", "ms": 3.6, "mfc": "white", "mec": INK, "mew": 0.7, "zorder": 6.0
}  # fmt: skip
GOAL: Line = {"ls": "", "marker": "*", "ms": 11, "mfc": INK, "mec": "white", "mew": 0.7, "zorder": 7.0}
AXES: dict[str, Line] = {  # of the hand: red, green and blue, as everywhere
    f"hand's {name} axis": {"color": colour, "lw": 1.1, "zorder": 5.8, "solid_capstyle": "butt"}
    for name, colour in zip("xyz", ("#D62728", "#2CA02C", "#3A3AFF"), strict=True)
}
LOST: Line = {"color": WITNESS, "lw": 1.8, "zorder": 7.5}
LOWEST: Line = {"ls": "", "marker": "D", "ms": 5, "mfc": "white", "mec": INK, "mew": 1.0, "zorder": 8.0}
NUMBERED: Line = {"fontsize": 8.0, "fontweight": "bold", "color": INK, "path_effects": HALO}
NOTED: Line = {"fontsize": 7.0, "color": INK, "path_effects": HALO, "zorder": 6.0}
FAINT: Line = {"color": "white", "lw": 0.7, "zorder": 4.0, "path_effects": OUTLINED}
PROVED: Line = {"color": INK, "lw": 1.4, "ls": (0, (5, 2)), "zorder": 4.0}

DPI = 150
SETTINGS: dict[Any, Any] = {
    "font.family": ["DejaVu Sans"],  # comes with Matplotlib: the same everywhere
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "axes.edgecolor": "#6E6E6E",
    "axes.linewidth": 0.7,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "figure.titlesize": 11.0,
    "figure.facecolor": "white",
    "text.parse_math": False,  # two dollars in a name do not make it a formula
    "axes.unicode_minus": True,
    "svg.hashsalt": "skillctl",
    "svg.fonttype": "path",  # looks the same without our font
    "pdf.fonttype": 42,
    "savefig.dpi": DPI,
}
WITHOUT_DATE: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": "skillctl"},
    "pdf": {"CreationDate": None, "Creator": "skillctl", "Producer": "skillctl"},
}


@contextmanager
def drawing() -> Iterator[None]:
    """Use the settings of this room, not the user's matplotlibrc, and restore all settings afterwards."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        yield


def encode(figure: Figure, form: str) -> bytes:
    """Return a figure as the bytes of a ``png``, ``svg`` or ``pdf`` file, without a date in them."""
    buffer = io.BytesIO()
    with drawing(), warnings.catch_warnings():
        # A name may hold letters that the font lacks, which are drawn as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(buffer, format=form, metadata=WITHOUT_DATE[form])
    maps = any(axes.images for axes in figure.axes)  # their colours need all bits
    return _with_palette(buffer) if form == "png" and not maps else buffer.getvalue()


def _with_palette(picture: io.BytesIO) -> bytes:
    """Return a PNG with 256 colours, enough for lines and tints: the file is a third as large."""
    from PIL import Image

    smaller = io.BytesIO()
    with Image.open(picture) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(
            smaller, "png", optimize=True, dpi=(DPI, DPI)
        )
    return smaller.getvalue()


def named(text: str, longest: int = 34) -> str:
    """Return a name from a file as a picture shows it: on one line, and not too long."""
    name = printable(text)
    return name if len(name) <= longest else f"…{name[1 - longest :]}"


def entries(*wanted: str) -> dict[str, Any]:
    """Return the wanted entries of a legend: a sample of each line, by its label."""
    known = {
        "demonstration": Line2D([], [], **DEMONSTRATED),
        "motion of the skill": Line2D([], [], **MOVED),
        "start": Line2D([], [], **STARTED),
        "attractor": Line2D([], [], **GOAL),
        "position density, 2σ": Patch(facecolor=to_tint(DENSITY, 0.14), edgecolor=DENSITY, lw=0.8),
        "learned without that demonstration": Line2D([], [], **HELD),
        **{name: Line2D([], [], **{**line, "lw": 2}) for name, line in AXES.items()},
        "witness: reaches no attractor": Line2D([], [], **LOST),
        "proved: no motion is slower": Line2D([], [], **PROVED),
        "lowest decay rate": Line2D([], [], **LOWEST),
        "proved radius": Line2D([], [], ls="", marker="o", ms=9, mfc="none", mec=QUIET, mew=1.4),
        "where a stage is over": Patch(facecolor=to_tint(QUIET, 0.35), edgecolor=QUIET, lw=1.0),
        "field": Line2D([], [], color=FLOW, lw=1.6),
        "level of V": Line2D([], [], color=QUIET, lw=0.8, ls=":"),
    }
    return {name: known[name] for name in wanted}


def part_colour(index: int) -> str:
    """Return the colour of a part of a combined skill, or of a stage of a chain."""
    return PARTS[index % len(PARTS)]


def moved_by(index: int) -> Line:
    """Return how the motion of a part of a combined skill looks: in its colour, darker than its tints."""
    red, green, blue = to_rgb(part_colour(index))
    return {**MOVED, "color": (DARKER * red, DARKER * green, DARKER * blue)}


def to_tint(colour: str, alpha: float) -> tuple[float, float, float, float]:
    """Return a colour made translucent."""
    return to_rgba(colour, alpha)


def legend(figure: Figure, handles: dict[str, Any], columns: int = 4) -> None:
    """Put one legend below all axes of a figure."""
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=columns)


def two_digits(value: float) -> str:
    """Return a number with two significant digits, for people."""
    return f"{float(f'{value:.2g}'):g}"


def logarithmic(axis: Any) -> None:
    """Label a logarithmic axis with plain numbers at 1, 2 and 5 of each decade."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def first(grid: Any, count: int) -> list[Axes]:
    """Return the first axes of a grid, and remove the others."""
    axes = list(grid.flat)
    for unused in axes[count:]:
        unused.remove()
    return axes[:count]


def tidy(axes: Sequence[Axes]) -> None:
    """Remove the upper and right frame of axes."""
    for each in axes:
        each.spines[["top", "right"]].set_visible(False)
