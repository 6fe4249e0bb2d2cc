"""The commands of `twin`, one file each, named as they are typed. A command reads its inputs, calls the
rooms below, says what it did and writes a run.

In the order of a project: `demo`, `init` (`initlike` for --like, `initsilicone` for --like with --body),
`setup`, `virtual`, `print` (`printframe` for --frame), `look`, `check`, `pick`, `camera`, `measure`,
`calibrate` (`calibratelaws` for --laws), `compare` (`comparetwo` for two projects), `diagnose`, `explain`,
`confirm`, `add`, `drop`, `profile`, `posterior`, `pareto`, `modes`, `explore` (`exploredesign` for
--export), `predict` (`predictobject` for --object, `predictchambers` for --shares, `predictweights` for
--weight), `export` (`exportasset` for a simulator), `study`, `review`, `recalibrate` (`recalibrateall` for
a folder of batches), `batches`, `list`, `trust`. `twin.chain` lists them, with what each stage reads and
writes.
"""
