"""Displacements that other programs measured, one file a format, as targets.

Begin with `recorded`: what every format gives. `deeplabcut`, `anipose`, `dice`, `matchid`, `motioncapture`
and `plainpoints` read one format each, and `catalogue` lists them. `supplied` is what the user states where
a file does not say it; `worldaxes` turns a file's axes into the world's; `conversion` makes targets of it
all.
"""
