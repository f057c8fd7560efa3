"""
Whitening of rows with white noise and exponentially correlated processes.

It is a Kalman filter over many columns at once.

The states are one process common to all rows, one per node, and three of the platform's position
(north, east, down). A row observes ``parts`` of them. Process k decays by ``exp(-step /
memory[k])`` and has variance ``variance[k]``, in units of the white noise.
"""

import math

from pymantaray.compile import entry


@entry
def whiten(rows, step, parts, memory, variance, mean, covariance, gain):  # type: ignore[no-untyped-def]
    """
    Convert rows (n, q) in place to innovations of unit variance.

    Return the sum of the logarithms of their variances.

    ``step`` (n,) is the time since the previous row, ``parts`` (n, S) the observation of each row.
    ``mean`` (S, q) and ``covariance`` (S, S) are those of the states after the previous row; the
    function updates them to the last row.
    """
    n_states = memory.size
    total = 0.0
    for i in range(rows.shape[0]):
        if step[i] > 0.0:
            for a in range(n_states):
                keep = math.exp(-step[i] / memory[a])
                for c in range(rows.shape[1]):
                    mean[a, c] *= keep
                for b in range(n_states):
                    covariance[a, b] *= keep
                    covariance[b, a] *= keep
                covariance[a, a] += variance[a] * (1.0 - keep * keep)
        size = 1.0
        for a in range(n_states):
            gain[a] = 0.0
            for b in range(n_states):
                gain[a] += covariance[a, b] * parts[i, b]
            size += gain[a] * parts[i, a]
        for a in range(n_states):
            if parts[i, a] != 0.0:
                for c in range(rows.shape[1]):
                    rows[i, c] -= parts[i, a] * mean[a, c]
        for a in range(n_states):
            share = gain[a] / size
            if share != 0.0:
                for c in range(rows.shape[1]):
                    mean[a, c] += share * rows[i, c]
            for b in range(n_states):
                covariance[a, b] -= share * gain[b]
        root = 1.0 / math.sqrt(size)
        for c in range(rows.shape[1]):
            rows[i, c] *= root
        total += math.log(size)
    return total
