"""Words of pages that a newcomer may not know, each with its meaning: tooltips of heads of tables, and a list on the page of a run."""

from collections.abc import Iterable

GLOSSARY = {
    "shadow": "No ray within the allowed bounces gets to the receiver.",
    "weak": "Rays arrive, but all are weaker than the cut-off allows: 15 dB beyond spherical spreading by default.",
    "blocked": "Rays that would arrive meet the sea bed.",
    "outside": "An end of the link is outside the water or the domain.",
    "stopped": "One of the vehicles has stopped and is silent.",
    "unheard": "A ray arrives, but the receiver did not detect it.",
    "unresolved": "The search for rays was cut short before it found one.",
    "leaked": "No ray, but sound that leaks past the nearest one.",
    "scattered": "No ray, but scattered sound.",
    "condition": "What the estimator uses as ranges, or the estimator's name.",
    "NEES": "Squared position error in the covariance that the estimator gives. Divided by its degrees of freedom it is 1 if the"
    " estimator is as good as its covariance says, above 1 if it is too sure.",
    "lower bound": "The posterior Cramér-Rao bound: the least RMSE that an unbiased estimator has with these measurements, on average"
    " over the noise. The RMSE of a few realizations can be below it.",
    "efficiency": "Square of the lower bound by the RMSE: 1 if the estimator reaches the bound.",
    "bending": "Range error because the ray is bent: its travel time less that along the straight line, times the reference speed.",
    "reference speed": "Range error because the sound speed at the transmitter is not the mean along the path.",
}
"""By the words as pages write them."""
_COLUMNS = {
    "bound_rmse_m": "lower bound",
    "ratio": "NEES",
    "nees": "NEES",
}


def meaning(column: str) -> str:
    """Meaning of a column's head by the column's name; empty if it needs none."""
    return GLOSSARY.get(_COLUMNS.get(column, column), "")


def explained(words: Iterable[str]) -> list[str]:
    """Lines of the glossary for some words, in its order."""
    chosen = set(words)
    return [f"{word}: {text}" for word, text in GLOSSARY.items() if word in chosen]
