"""Tables, figures and a page for the results of a study, and for two of them side by side.

matplotlib is imported when a report is first written.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pymantaray.report.compare import write_comparison
    from pymantaray.report.write import write_report

__all__ = ["write_comparison", "write_report"]


def __getattr__(name: str) -> Any:
    """Import what needs matplotlib on first use."""
    if name == "write_report":
        from pymantaray.report.write import write_report

        return write_report
    if name == "write_comparison":
        from pymantaray.report.compare import write_comparison

        return write_comparison
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
