"""Progress of jobs: types of callbacks, and a count of tasks."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, the number of its finished parts and the total."""
CountProgress = Callable[[int, int], None]
"""Called with the number of finished parts and the total."""
TaskProgress = Callable[[int, int, int], None]
"""Called with the number of finished tasks, the number of failed tasks and the total."""


class TaskCount:
    """Count of finished and failed tasks, which is reported at the start and after each task."""

    def __init__(
        self, total: int, progress: TaskProgress | None, *, done: int = 0, failed: int = 0
    ) -> None:
        self._total = total
        self._progress = progress
        self._done = done
        self._failed = failed
        self._report()

    def add(self, *, failed: bool) -> None:
        """Count a finished task."""
        self._done += not failed
        self._failed += failed
        self._report()

    def _report(self) -> None:
        if self._progress is not None:
            self._progress(self._done, self._failed, self._total)
