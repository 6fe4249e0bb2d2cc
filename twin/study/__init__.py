"""Two constants that trade off: what a calibration by few displacements finds, and what it leaves open.

Read `generations` first: the reference study's genetic algorithm on load paths. `loadpathfit` is its
objective and the least squares that begin where it ends, `severalstarts` the same from all over the bounds;
`fullsolves` shows the best of every generation,
and `known` says what is known then. `ridges` finds the line on which two constants act alike; `readings`
are places where one could read more, and `separability` says how well each would tell the constants apart.
`numbers` gathers all this, `record` is what is written of it, and `figures` draws it. `lawchoice`
fits several laws of the silicone alike and says which the targets cannot tell apart.
"""
