"""Displacements in mm from the pixels of one camera or several.

Read `views` first: what each camera recorded, and what was followed in it. Its `unsteady` tells whether the
lens stayed as it was. `restplaces` tells where the finger's marks sit and where the body stands, from the
film at rest. `singlecamera` places marks with one camera, in the plane of the frame marks; `planeerrors`
states what that camera cannot see. `multicamera` places them with several cameras: `triangulation` finds the
places in space, `clocks` brings the films to common times, `spaceerrors` states the errors. Both ways end in
`vision.errors.errormodel`, which puts all errors together. `loosemarkers` places markers of the rig by
pictures that show them with a board. `silhouettes` gives the outline of a solid as the camera sees it,
`restpictures` is the picture at rest, `waves` counts pleats in it, `outlines` tells where the body stands
and how large it is by that outline at rest, `movedoutlines` how far the edges of the moved body lie from a
model's.
"""
