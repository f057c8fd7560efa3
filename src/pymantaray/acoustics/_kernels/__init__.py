"""
Compiled ray machinery: Numba only, no allocation in the inner loops, workspaces passed in.

Each module uses those before it. `layout` names all columns and tuples (`at.NAME`). `field` cuts the sound speed along a link into a
`Section`. `step` has the ray equations and one step of them. `boundary` has sea bed and surface: where a ray meets them and how it is
reflected. `lanes` is arithmetic on eight numbers at once. Three tracers solve the same equations: `arcs` in closed form through layers
of constant gradient; `march` eight direct rays of a fan side by side, through smooth sound speed; `trace` any ray, and those that the
other two leave. `search` launches a fan and brackets the zeros of the miss; `refine` finds a zero by Newton's method and fills an
arrival's row; `cells` does so for reflected rays over a gridded bed, cell by cell; `search_reflected` searches both fans of reflected
rays. `link` solves one link from end to end, `paths` traces an eigenray again to record its path, `cuda` solves links on a device.

XI, the derivative of a ray's offset by its launch angle, changes its sign at every reflection; a zero of it anywhere else is a caustic.

To follow one link in a debugger, run without compilation (0.05 s for direct rays, 0.4 s with reflections)::

    NUMBA_DISABLE_JIT=1 python -c "from pymantaray.acoustics import *; print(find_eigenrays(Medium.from_profile(
        [0, 100, 1000], [1440, 1445, 1460], bottom_depth=1000), [0, 0, 50], [2000, 0, 300]).travel_time)"
"""
