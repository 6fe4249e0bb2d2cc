"""Meshes: made, refined, mirrored, deformed, converted, and searched for a point.

Read `finger` first: it builds the parametric bellows finger as a case (`fe.case`), and is the one place of
its geometry and its lattice; `dividing` chooses a lattice by the dimensions. `refine` and `mirror` change any
case; `inner` moves the chamber's surface while the outer one stays; `skin` lets walls touch each other;
`convert` makes Abaqus elements, `tetrahedra` divides mixed shapes into one.
`elementshapes` says how good the elements' shapes are. `points` finds where a point lies, `spreading` shares
a force at a place out to the nodes around it.
"""
