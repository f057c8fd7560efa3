"""
Compilation of numerical kernels: `kernel` decorates them and caches them on disk, `linking` makes
Numba compile many of them as one.
"""

from pymantaray.compile.kernel import PLAIN as PLAIN
from pymantaray.compile.kernel import cached_on_disk as cached_on_disk
from pymantaray.compile.kernel import compact as compact
from pymantaray.compile.kernel import entry as entry
from pymantaray.compile.kernel import inlined as inlined
from pymantaray.compile.kernel import kernel as kernel
from pymantaray.compile.kernel import out_of_line as out_of_line
from pymantaray.compile.kernel import shared as shared
