"""The pressure log, and how it is put on the film's clock.

Read `pressurelog` first: the log, the noise of its gauge, and what is wrong with its samples. `logcolumns`
finds its columns, `pressureunits` knows their units. `pressuretable` is [pressure] of twin.toml. `synchrony`
has the interface of the ways to synchronise film and log, and the estimator of the lag between pressure and
motion; `onset` is the longest of them. `agreement` refuses film and log that are not of one test, `clockfit`
those that do not run on one clock, by how late the finger moves at the pressure's corners.
"""
