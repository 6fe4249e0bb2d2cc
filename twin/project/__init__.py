"""A project folder on disk: twin.toml, targets and numbered runs.

`config` has every key of twin.toml, `toml` reads and writes it; `folder` is the project with its runs;
`targetfiles` (on `csvtable`) reads and writes targets; `files` writes every file whole or not at all.
"""
