"""HTML building blocks of a self-contained page: tables, figures with captions, one style sheet, nothing external."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from typing import Final

STYLE: Final = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; color: #222; background: #fff; margin: 2rem auto;
  max-width: 76rem; padding: 0 1.2rem; }
h1 { font-size: 1.7rem; margin-bottom: .3rem; }
h2 { font-size: 1.35rem; margin-top: 3rem; padding-bottom: .2rem; border-bottom: 2px solid #1b7f4b; }
h3 { font-size: 1.1rem; margin: 2.2rem 0 .3rem; }
p { margin: .4rem 0; max-width: 58rem; }
nav { column-width: 22rem; font-size: .92rem; }
nav a { display: block; }
a { color: #14603a; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .88rem; margin: .6rem 0 1rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: .2rem 0; }
th, td { padding: .22rem .65rem; text-align: right; white-space: nowrap; border-bottom: 1px solid #ddd; }
th { background: #f1f5f2; font-weight: 600; white-space: normal; vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
table.text td { white-space: normal; text-align: left; vertical-align: top; }
table.text th { text-align: left; }
.note { color: #555; font-size: .9rem; }
.yes { color: #14603a; font-weight: 600; }
.no { color: #b3202c; font-weight: 600; }
figure { margin: 1rem 0 1.6rem; }
img { width: 100%; height: auto; border: 1px solid #e3e3e3; }
figcaption { font-size: .88rem; color: #444; }
@media print { h2 { break-before: page; } figure, table { break-inside: avoid; } }
"""


def document(title: str, body: Iterable[str]) -> str:
    """A whole document."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "", kind: str = "") -> str:
    """Cells are HTML already."""
    head = "".join(f"<th>{heading}</th>" for heading in headings)
    body = "\n".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    title = f"<caption>{caption}</caption>" if caption else ""
    return (
        f'<div class="scroll"><table class="{kind}">{title}<thead><tr>{head}</tr></thead>'
        f"<tbody>\n{body}\n</tbody></table></div>"
    )


def figure(png: bytes, caption: str, alternative: str) -> str:
    """An embedded picture."""
    data = base64.b64encode(png).decode("ascii")
    return (
        f'<figure><img alt="{escape(alternative)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def verdict(is_met: bool) -> str:
    """Yes or no in colour and word."""
    return '<span class="yes">yes</span>' if is_met else '<span class="no">no</span>'
