"""Meshes: made, refined, mirrored, deformed, converted, and searched for a point.

Read `extruding` first: cells become a half model with a chamber, as a case (`fe.case`). `finger` is the
parametric bellows finger, the one place of its geometry and of its lattice, which follows from the
dimensions. `refine` and `mirror` change any case; `inner` moves the chamber's surface while the outer one
stays, and lets walls touch each other; `convert` makes Abaqus elements, `tetrahedra` divides mixed shapes
into one. `elementshapes` says how good the elements' shapes are. `points` finds where a point lies, `skin`
the faces on which a sleeve would lie.
"""
