"""Terms of pages with their meanings: tooltips of table heads, and a list on the page of a run."""

from collections.abc import Iterable

from pymantaray.records.status import RAY_STATUS_WORDS

GLOSSARY = {status.name.lower(): words.meaning for status, words in RAY_STATUS_WORDS.items()} | {
    "condition": "Type of ranges in the estimate, or name of the estimator.",
    "NEES": "Normalized estimation error squared: the squared position error relative to the"
    " estimated covariance. Divided by its degrees of freedom, its mean is 1 if the covariance is"
    " right, and above 1 if the covariance is too small.",
    "lower bound": "Posterior Cramér-Rao bound: the smallest RMSE of an unbiased estimator with"
    " these measurements, averaged over the noise. The RMSE of a few realizations can be below it.",
    "efficiency": "Squared ratio of the lower bound to the RMSE: 1 if the estimator reaches the"
    " bound.",
    "bending": "Range error because the ray is curved: its travel time minus that along the"
    " straight line, times the reference speed.",
    "reference speed": "Range error because the sound speed at the transmitter differs from the"
    " mean along the path.",
}
"""Meaning of each word, by the word as pages write it."""
_COLUMNS = {
    "bound_rmse_m": "lower bound",
    "ratio": "NEES",
    "nees": "NEES",
}


def meaning(column: str) -> str:
    """Meaning of the head of a column, by the column's name; empty if the head needs none."""
    return GLOSSARY.get(_COLUMNS.get(column, column), "")


def glossary_lines(words: Iterable[str]) -> list[str]:
    """Lines of the glossary for some words, in the order of the glossary."""
    selection = set(words)
    return [f"{word}: {text}" for word, text in GLOSSARY.items() if word in selection]
