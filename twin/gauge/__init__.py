"""The pressure log, and how it is put on the film's clock.

Read `pressurelog` first: the log, and the noise of its gauge. `logcolumns` finds its columns,
`pressureunits` knows their units, `logfaults` says what is wrong with its samples. `synchrony` says what a
way to synchronise film and log gives; `stamps`, `lamp` and `onset` are one way each; `ways` finds the one
that twin.toml names. `agreement` refuses film and log that are not of one test.
"""
