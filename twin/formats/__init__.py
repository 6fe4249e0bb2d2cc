"""Displacements that other programs measured, one file a format, as targets.

Begin with `recorded`, the result of every format; `lostpoints` leaves out what is no place. `deeplabcut`,
`anipose`, `dice`, `matchid`, `motioncapture` and `plainpoints` read one format each, `catalogue` lists them.
`supplied` is what [import] of twin.toml (`importtable`) states where a file does not say it, and
`conversion` makes targets of it all; `takes` does so of a folder of recordings, one a pressure. `meshgroups`
makes a deck of a mesh with named groups, or with those of its skin.
"""
