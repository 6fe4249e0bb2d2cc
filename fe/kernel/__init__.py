"""Residual and tangent of a case at a state, as Newton's method needs them.

Read `assembly` first: displacements and pressure modes in, residual and condensed tangent out, by the loops
over elements in `compiled` (the law at a point is `fe.terms`). `pressure`, `contact`, `layer` and, in a
time step, `inertia` add their forces; so does `selfcontact`, by the closest points that `projection` finds.
`matrix` holds and factorises the system; `systems` derives others from it: with dependent unknowns, as
`tying` says of tied meshes, with room for contact, with an unsymmetric part.
"""
