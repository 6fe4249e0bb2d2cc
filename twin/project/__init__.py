"""A project folder on disk: twin.toml, targets and numbered runs.

Begin with `folder`: a project, its runs, and what each run records of what it was made from. `config` has
every key of twin.toml, `cameratables` those of filming, `toml` reads and writes the file, `framesheet` the
printed sheet that it may name. `targetschema` has the keys of targets.toml, `targetfiles` reads and writes
the folder of targets. `record` has what a run and its targets say of themselves as JSON, and `trust` limits
what a folder from a stranger may do.
"""
