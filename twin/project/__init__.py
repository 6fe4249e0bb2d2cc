"""A project folder on disk: twin.toml, targets and numbered runs.

Begin with `folder`: a project, its runs, and what each run records of what it was made from; `staleness`
says what has changed since. `config` has every key of twin.toml, `validation` checks them, `toml` reads and
writes the file.
`targetschema` has the keys of targets.toml, `chambers` those of several chambers; `targetfiles` (on
`csvtable` and `targetarrays`) reads targets, `stillnoise` makes their noise model where there is no static
film, and `targetwriting` writes them. `record` says what JSON files are made of. `files` writes every file
whole or not at all, `locks` lets one command write at a time, and `trust` limits what a folder from a
stranger may do.
"""
