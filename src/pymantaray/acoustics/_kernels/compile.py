"""How kernels are compiled: no allocation, no reference counting, the GIL released."""

from numba import njit

# Arrays come in from outside and outlive the call, so that counting references to them in inner loops
# (two atomic operations an access; it made a field evaluation ten times slower) can be left out.
kernel = njit(cache=True, nogil=True, error_model="numpy", _nrt=False)

# The same for the innermost functions: passing a section's arrays costs more than their arithmetic.
inlined = njit(cache=True, nogil=True, error_model="numpy", _nrt=False, forceinline=True)

# The one that makes the workspaces.
driver = njit(cache=True, nogil=True, error_model="numpy")


@kernel
def sort_head(values, count):
    """Sort the first count values in place (insertion sort: short and nearly sorted input)."""
    for i in range(1, count):
        v = values[i]
        j = i - 1
        while j >= 0 and values[j] > v:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = v
