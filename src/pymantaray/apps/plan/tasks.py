"""Task of a worker: the scores of one design."""

from dataclasses import dataclass, field
from typing import ClassVar

from pymantaray.apps.plan.definition import DeploymentPlan, Design
from pymantaray.apps.plan.evaluate import DesignEvaluator, Scores
from pymantaray.installation import code_version
from pymantaray.jobs.keys import digest
from pymantaray.jobs.pool import one_task

_latest: dict[str, DesignEvaluator] = {}
"""Evaluator of the latest plan of this process, by the plan's key."""


@dataclass(frozen=True)
class DesignTask:
    """Design to evaluate, with all data for it."""

    plan: DeploymentPlan
    plan_key: str
    design: Design
    version: str = field(default_factory=code_version)
    kind: ClassVar[str] = "design"

    @property
    def key(self) -> str:
        """Key of the design in its plan."""
        return digest(self.kind, [self.plan_key, self.design], {})


def evaluate_task(task: DesignTask) -> list[Scores]:
    """
    Scores of a design in each water; waters and links of earlier designs of the same plan are used
    again.
    """
    with one_task(task.version):
        return evaluator_of(task.plan, task.plan_key)(task.design)


def evaluator_of(plan: DeploymentPlan, key: str) -> DesignEvaluator:
    """Evaluator of a plan in this process."""
    if key not in _latest:
        _latest.clear()
        _latest[key] = DesignEvaluator(plan)
    return _latest[key]
