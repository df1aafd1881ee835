"""Leaderboards as LaTeX tables, to be read in with the package booktabs."""

from __future__ import annotations

from collections.abc import Sequence

from roadscope.benchmarks.boards.breakdown_tables import parts_as_text
from roadscope.benchmarks.boards.columns import COLUMNS, ENTRY, in_one_line
from roadscope.benchmarks.boards.results import Results
from roadscope.benchmarks.boards.rows import FIRST_METRIC
from roadscope.benchmarks.boards.tables import figure

ESCAPED = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
}  # fmt: skip


def to_latex(results: Results) -> str:
    """Return each board as a tabular, intervals with its first figure, then broken down."""
    return "\n\n".join(_board(results, board) for board in results.boards()) + "\n"


def escaped(text: str) -> str:
    """Return text as LaTeX prints it."""
    return "".join(ESCAPED.get(letter, letter) for letter in text)


def _board(results: Results, board: str) -> str:
    columns, first = COLUMNS[board], FIRST_METRIC[board]
    headings = ["", ENTRY[board], *(in_one_line(heading) for heading, _ in columns.values())]
    rows = [
        [
            results.standing(board, entry).place,
            entry,
            *(
                figure(results.row(board, entry, metric), digits, interval=metric == first)
                for metric, (_, digits) in columns.items()
            ),
        ]
        for entry in results.entries(board)
    ]
    tables = [_table(f"{board} board", "rl" + "r" * len(columns), [headings, *rows])]
    for title, (top, *cells) in parts_as_text(results, board):
        tables.append(_table(f"{board}: {title}", "l" + "r" * (len(top) - 1), [top, *cells]))
    return "\n\n".join(tables)


def _table(title: str, alignment: str, rows: Sequence[Sequence[str]]) -> str:
    headings, *lines = (" & ".join(map(escaped, row)) + r" \\" for row in rows)
    parts = [f"% {title}", rf"\begin{{tabular}}{{{alignment}}}", r"\toprule", headings]
    return "\n".join([*parts, r"\midrule", *lines, r"\bottomrule", r"\end{tabular}"])
