"""Executors of independent tasks: this process, local processes, or the workers of a dask cluster.

Read `protocol` first: the interface of executors. `local` has this process and others of this machine, and
the executor in use; `daskcluster` the workers of a scheduler, which `surroundings` compares with this
computer. `clusters` turns the value of --cluster into an executor, with jobs of SLURM where a file asks for
them. No result depends on the executor.
"""
