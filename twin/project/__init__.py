"""A project folder on disk: twin.toml, targets and numbered runs.

Begin with `folder`: a project, its runs, and what each run records of what it was made from. `staleness` says
what has changed since. `config` has every key of twin.toml, `toml` reads and writes it. `targetfiles` (on
`csvtable`) reads targets, `targetwriting` writes them. `files` writes every file whole or not at all, and
`locking` lets one command write at a time.
"""
