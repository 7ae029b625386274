"""Gates of pipelines: what a run has to reach, alone or against a stored run, as checks with a verdict each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from smartplay_tools.evaluation.analysis.comparison import compare
from smartplay_tools.evaluation.analysis.decisions import Margin
from smartplay_tools.evaluation.analysis.grouping import by_cell, labels
from smartplay_tools.evaluation.analysis.pairs import MEASURES, RowCondition, values
from smartplay_tools.records.rows import Row


@dataclass(frozen=True)
class Gate:
    """One check of a run."""

    game: str
    name: str
    passed: bool
    message: str


def mean_gates(rows: Sequence[Row], fail_if: Sequence[RowCondition]) -> Iterator[Gate]:
    """Yield a gate for every cell and condition: it fails if the condition holds for the cell's mean."""
    groups = by_cell(rows)
    for (cell, members), label in zip(groups, labels([cell for cell, _ in groups]), strict=True):
        for condition in fail_if:
            name = ", ".join(filter(None, (cell.player, label, str(condition))))
            measured = values(members, MEASURES[condition.measure])
            if not measured:
                yield Gate(cell.game, name, False, f"There is no {condition.measure}.")
                continue
            mean = sum(measured) / len(measured)
            message = f"{condition.measure} is {mean:.4g} (mean of {len(measured)})"
            yield Gate(cell.game, name, not condition.holds(mean), message)


def baseline_gates(rows: Sequence[Row], baseline: Sequence[Row], margin: Margin) -> Iterator[Gate]:
    """Yield a gate for every pairing with a stored run: it fails if this run is worse by more than the margin.

    An undecided pairing passes, and its message says so: a gate that fails by chance is soon ignored.
    """
    comparison = compare({"baseline": baseline, "run": rows}, margin=margin)
    for each in comparison.pairings:
        verdict, difference = each.verdict, each.differences.get("score")
        name = ", ".join(filter(None, (each.side.player, each.side.label)))
        if verdict is None or difference is None:
            yield Gate(each.game, f"{name}, baseline", False, "No episode has a counterpart in the baseline.")
            continue
        worse = verdict.word == "different" and difference.mean < 0
        message = f"{verdict.word} within {verdict.margin:g}: {difference.mean:+.4g} in {each.pairs} pairs"
        yield Gate(each.game, f"{name}, baseline", not worse, message)


def junit(gates: Sequence[Gate], name: str) -> str:
    """Return gates as JUnit XML, which continuous integration shows as tests."""
    failed = sum(not gate.passed for gate in gates)
    suites = ElementTree.Element("testsuites")
    counts = {"name": name, "tests": str(len(gates)), "failures": str(failed), "errors": "0"}
    suite = ElementTree.SubElement(suites, "testsuite", counts)
    for gate in gates:
        case = ElementTree.SubElement(suite, "testcase", {"classname": gate.game, "name": gate.name})
        if gate.passed:
            ElementTree.SubElement(case, "system-out").text = gate.message
        else:
            ElementTree.SubElement(case, "failure", {"message": gate.message}).text = gate.message
    ElementTree.indent(suites)
    return ElementTree.tostring(suites, encoding="unicode", xml_declaration=True) + "\n"
