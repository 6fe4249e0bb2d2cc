"""Displacements that other programs measured, one file a format, as targets.

Begin with `recorded`, the result of every format; `lostpoints` leaves out what is no place. `deeplabcut`,
`anipose`, `dice`, `matchid`, `motioncapture` and `plainpoints` read one format each, `catalogue` lists them.
`supplied` is what [import] of twin.toml (`importtable`) states where a file does not say it, `basemotion`
takes the motion of a base off, `settledsteps` reads a step whose top alone is known, and `conversion` makes
targets of it all; `takes` does so of a folder of recordings, one a pressure. `motionfile` reads a file
without a project. `meshgroups` makes a deck of a mesh with named groups, or with those of its skin.
"""
