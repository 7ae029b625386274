"""Tables in LaTeX: those of every command compile, keep their hierarchy, and have labels of their own."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections import Counter

import pytest

from smartplay_tools.evaluation.analysis.details import details
from smartplay_tools.evaluation.analysis.formats import Column, TextTable, to_latex
from smartplay_tools.evaluation.analysis.headline import headline
from smartplay_tools.evaluation.analysis.summary import summarize
from tests.evaluation.command import shown_by
from tests.evaluation.runs import failed_row, play_rows

HANOI = "Hanoi3Disk-v0"
GRID = "--players rule,random --prompt-tokens 500,800,none --tool-calls 6 --trials 10 --executor inline"
SWEEP = f"sweep --games {HANOI},BanditTwoArmedHighLowFixed-v0 {GRID} --out sweep --format latex"
REPEATS = f"eval --games {HANOI} --players random --tool-calls 6 --trials 3 --repeats 2 --executor inline --out repeats"
"""What is played. Every command that follows prints tables."""

TABLES = {
    SWEEP: ["windows"],
    "cost sweep --cache anthropic-512 --cache openai:gpt-5.5 --format latex": [
        "what an episode and a point of score cost",
        "which window is cheapest",
    ],
    "compare sweep --format latex": ["compared"],
    "results sweep --all --format latex": [
        "scores",
        "capabilities, the paper's weights",
        "how it went",
        "what it took",
    ],
    "results repeats --format latex": ["repeats"],
}


def compiled(text, folder):
    """Whether LaTeX makes a document of the tables; skips where there is no LaTeX."""
    if shutil.which("pdflatex") is None:
        pytest.skip("There is no pdflatex: apt install texlive-latex-recommended")
    document = "\\documentclass{article}\\usepackage{booktabs}\\begin{document}" + text + "\\end{document}"
    (folder / "tables.tex").write_text(document, encoding="utf-8")
    command = ["pdflatex", "-draftmode", "-interaction=nonstopmode", "-halt-on-error", "tables"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
    return done.returncode == 0 and "Missing character" not in done.stdout


def check_form(text):
    """Every table is balanced, and all of its rows have as many cells as it has columns."""
    for part in text.split("\\begin{table}")[1:]:
        plain = re.sub(r"\\[&%$#_{}]", "", part)
        assert plain.count("{") == plain.count("}")
        lines = [line for line in plain.splitlines() if line.endswith("\\\\") and "multicolumn" not in line]
        (columns,) = re.findall(r"\\begin{tabular}{([lr]+)}", plain)
        assert {line.count("&") for line in lines} == {len(columns) - 1}


@pytest.mark.slow
def test_every_table_of_every_command_compiles(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pages = []
    for command in (REPEATS, *TABLES):
        shown = shown_by(*command.split())
        if command in TABLES:
            pages.append(shown)
            check_form(shown)
            labels = Counter(re.findall(r"\\label{(.*)}", shown))
            assert set(labels.values()) == {1}
            for title in TABLES[command]:
                assert f"\\caption{{{title[0].upper()}{title[1:]}" in shown, title
    assert compiled("\n".join(pages), tmp_path)


def test_every_table_of_results_is_well_formed_and_keeps_its_hierarchy(tmp_path):
    rows = play_rows(HANOI, trials=2)
    summary = summarize(rows, [failed_row(rows[0])])
    tables = [headline(summary), *details(summary), TextTable("", (Column("a"), Column("b")), (("[1]", "-0.5"),))]
    text = "\n".join(map(to_latex, tables))
    assert "\\quad rule & 2 &" in text
    assert "{}[1] & $-$0.5" in text
    assert "\\caption{Attempts without a result" in text
    check_form(text)
    assert compiled(text, tmp_path)


def test_what_latex_would_read_is_escaped():
    rows = (("a_game",), ("  one|two", "<5%"), ("  three", "1 [0, 2]"))
    table = TextTable("what & why", (Column("player", words=True), Column("score")), rows, ("a note",))
    text = to_latex(table)
    for line in (
        "\\caption{What \\& why.}",
        "\\par{\\footnotesize a note\\par}",
        "\\multicolumn{2}{l}{a\\_game} \\\\",
        "\\toprule",
        "\\bottomrule",
    ):
        assert line in text
    assert "\\quad one\\textbar{}two & \\textless{}5\\% \\\\" in text
    assert "%" not in text.replace("\\%", "").replace("% \\usepackage{booktabs}", "")
    assert "\\label{tab:what-why}" in text
    assert "\\label{tab:what-why-2}" in to_latex(table, 2)
