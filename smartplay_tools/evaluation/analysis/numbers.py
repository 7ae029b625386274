"""The formatting of numbers, which is the same in terminals, notebooks and papers.

All numbers of one column and one game have the same number of decimals, so that they can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from smartplay_tools.statistics.intervals import FEW, MeanEstimate

NOTHING = "-"
"""The text for a missing number."""

IDENTICAL = "identical: every prompt and reply is equal in all pairs"


def decimals_of(estimates: Iterable[MeanEstimate | None]) -> int:
    """Return the number of decimals for estimates that are printed next to each other: about four digits."""
    ends = [
        end
        for estimate in estimates
        if estimate is not None
        for end in (estimate.mean, estimate.low, estimate.high)
        if end is not None
    ]
    largest = max(map(abs, ends), default=0.0)
    return 2 if largest < 100 else 1 if largest < 1000 else 0


def with_interval(estimate: MeanEstimate | None, decimals: int, *, factor: float = 1, sign: str = "-") -> str:
    """Return "mean [low, high]", the mean alone for one episode, or that all are equal where no bounds are declared.

    `factor` is 100 for percent; `sign` is "+" for differences, which are printed with their sign. A difference that is
    the same in all pairs has no interval here: that it is 0 is said in words, and another one has the p value of the
    sign test.
    """
    if estimate is None:
        return NOTHING
    mean = fixed(factor * estimate.mean, decimals, sign)
    if sign == "+" and estimate.sign_p is not None:
        return f"{mean} in all {estimate.episodes}, p {estimate.sign_p:.1g}"
    if sign == "+" and estimate.is_zero:
        return f"equal in all {estimate.episodes}"
    if estimate.low is None or estimate.high is None:
        return f"{mean} (all {estimate.episodes} equal)" if estimate.all_equal else mean
    return f"{mean} [{fixed(factor * estimate.low, decimals, sign)}, {fixed(factor * estimate.high, decimals, sign)}]"


def amount(estimate: MeanEstimate | None, show: Callable[[float], str]) -> str:
    """Return "mean [low, high]" of an amount that is at least 0."""
    if estimate is None:
        return NOTHING
    if estimate.low is None or estimate.high is None:
        return show(estimate.mean)
    return f"{show(estimate.mean)} [{show(max(0.0, estimate.low))}, {show(estimate.high)}]"


def interval_notes(estimates: Iterable[MeanEstimate | None]) -> list[str]:
    """Return what a reader of these intervals has to know: where equal episodes have none, and where there are few."""
    shown = [estimate for estimate in estimates if estimate is not None]
    equal = {each.note for each in shown if each.low is None and each.all_equal and each.note}
    few = [f"few episodes: with fewer than {FEW}, an interval is a rough guide and sees no rare failures"]
    return [*sorted(equal), *(few if any(each.episodes < FEW for each in shown) else [])]


def percent(share: float | None) -> str:
    """Return a share in percent; only 0 is printed as 0, and only 1 as 100."""
    if share is None:
        return NOTHING
    if 0 < share < 0.005:
        return "<1%"
    return ">99%" if 0.995 <= share < 1 else f"{share:.0%}"


def count(episodes: int, estimate: MeanEstimate) -> str:
    """Return a number of episodes and, if it differs, that of the worlds or chains whose means are the sample."""
    return f"{episodes}" if estimate.episodes == episodes else f"{episodes} in {estimate.episodes}"


def dollars(amount: float | None) -> str:
    """Return an amount in US dollars, in cents or, below a cent, with two significant digits."""
    if amount is None:
        return NOTHING
    return "0" if amount == 0 else f"{amount:,.2f}" if amount >= 0.1 else f"{amount:.2g}"


def fixed(value: float, decimals: int, sign: str = "-") -> str:
    """Return a number with this many decimals and commas between thousands; zero has no minus sign."""
    text = f"{value:{sign},.{decimals}f}"
    return text.replace("-", "") if text.startswith("-") and not text.strip("-0.,") else text
