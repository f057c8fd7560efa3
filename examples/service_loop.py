"""
A simulator's loop that hears by refracted sound: unicycles ping in turn, each message arrives when
its ray does.
"""

import heapq

import numpy as np

from pymantaray.apps.service import RangingService
from pymantaray.records import RayStatus

NAMES = ("A", "B", "C", "D")
STEP, SLOT, DURATION = 0.1, 5.0, 60.0  # s
NOMINAL_SPEED = 1500.0  # m/s, what a simulator without an ocean takes


def move(position: np.ndarray, heading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unicycles at 1.5 m/s that turn slowly, for one step."""
    step = 1.5 * STEP * np.stack([np.cos(heading), np.sin(heading), np.zeros(len(heading))], axis=1)
    return position + step, heading + STEP * np.radians([0.5, -1.0, 0.2, 0.0])


def main() -> None:
    """Let each vehicle ping in its slot, and tell what the others make of it."""
    rng = np.random.default_rng(7)
    position = np.column_stack(
        [rng.uniform(-2e3, 2e3, (len(NAMES), 2)), [20.0, 60.0, 150.0, 300.0]]
    )
    heading = rng.uniform(0.0, 2.0 * np.pi, len(NAMES))
    on_its_way: list[tuple[float, str, str, float, float]] = []
    with RangingService("synthetic:beaufort") as service:
        for tick in range(round(DURATION / STEP)):
            now = tick * STEP
            if tick % round(SLOT / STEP) == 0:
                sender = tick // round(SLOT / STEP) % len(NAMES)
                others = [k for k in range(len(NAMES)) if k != sender]
                ping = service.ping(now, position[sender], position[others])
                for row, k in enumerate(others):
                    if np.isfinite(ping.arrival_time[row]):
                        straight = float(ping.straight_range[row])
                        event = (
                            float(ping.arrival_time[row]),
                            NAMES[k],
                            NAMES[sender],
                            now,
                            straight,
                        )
                        heapq.heappush(on_its_way, event)
                    else:
                        status = RayStatus(ping.status[row]).name.lower()
                        print(
                            f"{now:7.3f} s {NAMES[sender]} pings, {NAMES[k]} hears nothing:"
                            f" {status}"
                        )
            position, heading = move(position, heading)
            while on_its_way and on_its_way[0][0] <= now + STEP:
                time, receiver, source, sent, straight = heapq.heappop(on_its_way)
                error = NOMINAL_SPEED * (time - sent) - straight
                print(f"{time:7.3f} s {receiver} hears {source}: {error:+6.2f} m off at 1500 m/s")


if __name__ == "__main__":
    main()
