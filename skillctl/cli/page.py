"""A skill as one HTML page: tables and pictures in a single file that needs no network and no scripts."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING

import skillctl
from skillctl.cli import render, words
from skillctl.errors import UsageError, printable, require_directory

if TYPE_CHECKING:
    from skillctl.usecases.history import LineageReport
    from skillctl.usecases.inspect import InspectReport
    from skillctl.usecases.pictures import Picture

SUFFIXES = (".html", ".htm")


def require_page(path: Path) -> None:
    """Raise UsageError or StoreError unless an HTML page can be written there."""
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"{printable(str(path))}: a page ends in {' or '.join(SUFFIXES)}.",
            hint=f"For example: --html {printable(path.stem or 'skill')}.html",
        )
    require_directory(path)


def page(
    report: InspectReport,
    blocks: Sequence[render.Block],
    lineage: tuple[LineageReport, render.Block],
    pictures: Sequence[Picture],
) -> str:
    """Return the page of a skill; the same skill gives the same page.

    Args:
        report: What the skill is.
        blocks: The same in words: first facts, then tables, last where it comes from.
        lineage: What it was made from, and the table of that.
        pictures: To be shown between them.
    """
    certificate = report.certificate
    tone = "stable" if certificate.verdict == "stable" else "open"
    note = report.operation.note
    absent = "" if lineage[0].complete else "<p>Some of these skills are not where they were.</p>"
    body = [
        f"<h1>{_safe(report.skill)}</h1>",
        f'<p class="verdict {tone}">{_safe(certificate.verdict)}</p>',
        f"<blockquote>{_safe(note)}</blockquote>" if note else "",
        _block(blocks[0]),
        *(_figure(picture, report.skill) for picture in pictures),
        "<h2>The proof</h2>",
        _sentences([*certificate.proof, *certificate.failures, *certificate.evidence]),
        "<h2>Its parts and demonstrations</h2>",
        *map(_block, blocks[1:-1]),
        _sentences(f"{name}: {meaning}" for name, meaning in words.MEANINGS.items()),
        "<h2>Where it comes from</h2>",
        _block(lineage[1]),
        absent,
        _block(blocks[-1]),
        f"<footer>Written by skillctl {_safe(skillctl.__version__)} from the content with the digest "
        f"{_safe(report.digest)}.</footer>",
    ]
    # The form loads nothing and runs nothing, whatever a name or a note in the file tries.
    form = Template((Path(__file__).parent / "page.html").read_text(encoding="utf-8"))
    return form.substitute(title=_safe(report.skill), body="\n".join(filter(None, body)))


def _safe(text: str) -> str:
    """Return text that shows as it is: nothing of it is markup, and control characters are spelt out."""
    return html.escape(printable(text))


def _figure(picture: Picture, skill: str) -> str:
    # As an image and not inline: scripts in it would not run, and its names cannot clash with others.
    data = base64.b64encode(picture.svg).decode()
    image = f'<img alt="{_safe(f"{picture.title}: {skill}")}" src="data:image/svg+xml;base64,{data}">'
    return f"<h2>{_safe(picture.title)}</h2>\n<figure>{image}</figure>"


def _sentences(sentences: Iterable[str]) -> str:
    return "<ul>\n" + "\n".join(f"<li>{_safe(sentence)}</li>" for sentence in sentences) + "\n</ul>"


def _row(cells: Sequence[str], tags: Sequence[str]) -> str:
    inside = "".join(f"<{tag}>{_safe(cell)}</{tag}>" for tag, cell in zip(tags, cells, strict=True))
    return f"<tr>{inside}</tr>"


def _block(block: render.Block) -> str:
    """Return a block of a report as HTML."""
    if isinstance(block, render.Facts):
        rows = "\n".join(_row(item, ("th", "td")) for item in block.items)
        return f'<table class="facts">\n{rows}\n</table>'
    if isinstance(block, render.Table):
        count = len(block.headings)
        rows = "\n".join(_row(row, ["td"] * count) for row in block.rows)
        inside = f"<thead>{_row(block.headings, ['th'] * count)}</thead>\n<tbody>\n{rows}\n</tbody>"
        return f'<div class="wide"><table>\n{inside}\n</table></div>'
    if isinstance(block, render.Lines):
        return f"<p>{_safe(block.title)}</p>\n{_sentences(block.sentences)}"
    return f"<p>{_safe(block)}</p>"
