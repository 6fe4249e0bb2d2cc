"""The one door of this package: `measure(views, marks, ...)` in `displacements`.

It looks at every film, places the marks and states their errors. `face` adds points of a speckled side face,
which are then treated like marks; `strains` gives the strain between them. `keptsteps` tells which frames
are kept as steps.
"""
