"""The residual and the tangent of a case at a state: what Newton's method solves.

Read `assembly` first: displacements and pressure modes in, residual and condensed tangent out, by the loops
over elements in `compiled` (the law at a point is `fe.terms`). `pressure`, `contact` and `layer` add their
forces; `pattern` and `matrix` hold and factorise the system, `reduced` one in which some unknowns follow
others, as `tying` says of tied meshes; `coupling` adds an unsymmetric part on few unknowns.
"""
