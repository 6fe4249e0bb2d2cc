"""Calibration by a few displacements, as in the reference study: searches for constants, and limits.

Read `generations` first: the reference study's genetic algorithm on load paths. `loadpathfit` holds its
objective and the least squares that begin at its end, `carrying` tells up to which pressure constants that
fit the rest carry the load, `multistart` repeats them from all over the bounds, and `fullsolves` solves the
best of every generation. `identifiability` finds the line on which two constants act alike and puts their
accuracy into words, and `separability` rates further readings that would tell the constants apart.
`reference` makes the record and the seven figures of `twin study`, `record` holds its sentences and tables.
`lawchoice` fits several laws of the silicone and compares them by evidence.
"""
