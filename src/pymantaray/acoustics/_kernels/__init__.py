"""
Compiled ray tracing: only Numba, no allocation in the inner loops, workspaces as arguments.

Each module uses the modules before it in this list. `layout` names all columns and tuples
(`at.NAME`). `field` computes the sound speed in a vertical section along a link, a `FieldSection`.
`step` contains the ray equations and one integration step. `boundary` contains sea bed and surface:
intersections with rays, and reflections. `lanes` is arithmetic on sixteen numbers at once. Three
tracers solve the same equations: `curves` layer by layer through water that varies with depth only;
`march` for sixteen direct rays of any links at a time, through smooth sound speed; `trace` for any
ray, including those that the other two cannot trace. `search` launches a fan and brackets the zeros
of the miss; `refine` finds a zero by Newton's method and fills the row of an arrival; `cells` does
the same for reflected rays over a gridded bed, for given cells; `search_reflected` searches both
fans of reflected rays. `flights` contains the links whose rays `march` traces together. `link`
solves links, and `paths` traces an eigenray again to record its path.

XI, the derivative of a ray's offset by its launch angle, changes its sign at every reflection. A
zero anywhere else is a caustic.

To follow one link in a debugger, run without compilation (0.05 s for direct rays, 0.4 s with
reflections)::

    NUMBA_DISABLE_JIT=1 python -c "from pymantaray.acoustics import *;
    print(find_eigenrays(Medium.from_profile(
        [0, 100, 1000], [1440, 1445, 1460], bottom_depth=1000), [0, 0, 50], [2000, 0,
        300]).travel_time)"
"""
