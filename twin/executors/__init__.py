"""Where work is done that needs no other's result: here, in local processes, or on a cluster of dask.

Read `protocol` first: what every executor does, and results in the order of their tasks. `local` has this
process and others of this machine, `daskcluster` the workers of a scheduler, which `surroundings` compares
with this computer. `clusters` turns what --cluster says into an executor, `slurm` a file into jobs, and
`chosen` keeps which one is used. No result depends on it.
"""
