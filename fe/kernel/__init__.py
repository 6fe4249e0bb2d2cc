"""The residual and the tangent of a case at a state: what Newton's method solves.

Read `assembly` first: displacements and pressure modes in, residual and condensed tangent out, by the loops
over elements in `compiled` (the law at a point is `fe.terms`). `pressure`, `contact` and `layer` add their
forces; so does `selfcontact`, by the closest places that `projection` finds. `pattern` and `matrix` hold and
factorise the system, `widening` makes room in it for faces that meet, `reduced` is one in which some unknowns
follow others, as `tying` says of tied meshes; `coupling` adds an unsymmetric part on few unknowns.
"""
