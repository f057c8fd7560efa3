"""
Compilation of numerical kernels: `kernel` decorates them and caches them on disk, `linking` makes
Numba compile many of them as one.
"""

from pymantaray.compile.kernel import (
    PLAIN as PLAIN,
    cached_on_disk as cached_on_disk,
    compact as compact,
    entry as entry,
    inlined as inlined,
    kernel as kernel,
    out_of_line as out_of_line,
    shared as shared,
)
