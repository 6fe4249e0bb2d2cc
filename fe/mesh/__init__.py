"""Meshes: made, refined, mirrored, deformed, converted, and searched for a point.

`finger` builds the parametric bellows finger as a `Case`; `refine` and `mirror` change any case; `inner`
moves the chamber's surface through the walls; `convert` makes Abaqus elements; `points` finds where a
point lies.
"""
