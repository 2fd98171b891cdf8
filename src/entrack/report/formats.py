"""Tables as CSV, Markdown and LaTeX."""

import csv as csv_
import io

from entrack.report.table import Line, Table


def texts(table: Table) -> dict[str, str]:
    """A table in every format, by the ending of its file."""
    return {"csv": csv(table), "md": markdown(table), "tex": latex(table)}


def csv(table: Table) -> str:
    """Comma-separated, with all decimals, and intervals as columns of their own."""
    wide = [any(line.cells[i].interval for line in table.lines) for i in range(len(table.columns))]
    out = io.StringIO()
    writer = csv_.writer(out, lineterminator="\n")
    head: list[str] = []
    for column, with_interval in zip(table.columns, wide, strict=True):
        bounds = [f"{column.title} 95% low", f"{column.title} 95% high"]
        head += [column.title, *(bounds if with_interval else [])]
    writer.writerow([*head, "quoted"])
    for line in table.lines:
        row: list[str | float | None] = []
        for cell, with_interval in zip(line.cells, wide, strict=True):
            row += [cell.value, *((cell.interval or (None, None)) if with_interval else ())]
        writer.writerow([*row, "yes" if line.quoted else "no"])
    return out.getvalue()


def markdown(table: Table) -> str:
    """A pipe table under its caption, the best in bold and quoted lines in italics."""
    head = [_escape(c.title, _MARKDOWN) for c in table.columns]
    rule = ["---:" if c.numeric else "---" for c in table.columns]
    body = [_words(table, line, _MARKDOWN, "**{}**", "*{}*") for line in table.lines]
    rows = "".join(f"| {' | '.join(words)} |\n" for words in (head, rule, *body))
    parts = [_escape(table.caption, _MARKDOWN), rows.rstrip(), _escape(table.note, _MARKDOWN)]
    return "\n\n".join(part for part in parts if part) + "\n"


def latex(table: Table) -> str:
    """A table for the packages booktabs and graphicx; the best in bold, quoted in italics."""
    align = "".join("r" if c.numeric else "l" for c in table.columns)
    head = [_escape(c.title, _LATEX) for c in table.columns]
    body = [_words(table, line, _LATEX, r"\textbf{{{}}}", r"\textit{{{}}}") for line in table.lines]
    rows = [" & ".join(words) + r" \\" for words in body]
    caption = " ".join(part.rstrip(".") + "." for part in (table.caption, table.note) if part)
    return "\n".join(
        [
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{_escape(caption, _LATEX)}}}",
            rf"\begin{{tabular}}{{{align}}}",
            r"\toprule",
            " & ".join(head) + r" \\",
            r"\midrule",
            *rows,
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def _words(table: Table, line: Line, escapes: dict[str, str], bold: str, italic: str) -> list[str]:
    words: list[str] = []
    for at in range(len(table.columns)):
        word = _escape(table.text(line, at), escapes)
        word = bold.format(word) if table.is_best(line, at) else word
        interval = table.interval(line, at)
        word = f"{word} {_escape(interval, escapes)}" if interval else word
        words.append(italic.format(word) if line.quoted and at == 0 else word)
    return words


_MARKDOWN = {c: f"\\{c}" for c in "\\|*_`[]"} | {"<": "&lt;", ">": "&gt;", "&": "&amp;"}
_LATEX = {c: f"\\{c}" for c in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "–": "--",
    "−": "$-$",
    "α": r"$\alpha$",
    "²": "$^2$",
}


def _escape(text: str, escapes: dict[str, str]) -> str:
    flat = " ".join(text.split())
    return "".join(escapes.get(character, character) for character in flat)
