"""
Compiled ray machinery: Numba only, no allocation in the inner loops, workspaces passed in.

Each room uses those before it: `layout` names every column and tuple; `field` cuts the medium along a link; `step` has the ray
equations and one step of them; `boundary` sea bed and ice, where a ray meets them and how it is reflected; `trace` how a link's rays are
followed, and one ray; `search` the fan and its brackets; `refine` Newton's method within a bracket, and an arrival's row; `cells`
reflected rays over a gridded bed, cell by cell; `search_reflected` both fans of reflected rays; `link` one link from end to end; `paths`
the path of a ray that was found; `cuda` links on a device.
"""
