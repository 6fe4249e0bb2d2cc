"""The commands of `twin`, one file each, named as they are typed. A command reads its inputs, calls the
rooms below, says what it did and writes a run.

A project begins with `demo`, `init` (`initlike` for --like, `initsilicone` for --like with --body), `setup`
or `virtual`. `print` (`printframe` for --frame), `look`, `check` and `pick` prepare it. Its stages are
`camera`, `measure`, `calibrate` (`calibratelaws` for --laws), `compare` (`comparetwo` for two projects),
`diagnose`, `add` and `review`. What else is asked of effects: `explain`, `confirm`, `drop`. What is asked of
a fit: `profile`, `posterior`, `pareto`, `explore` (`exploredesign` for --export), `modes`, `ringing`,
`study`. `predict` has `predictobject` for --object, `predictchambers` for --shares, `predictweights` for
--weight and `predictfast` for a fast course; `export` has `exportasset` for a simulator. Batches are those of
`recalibrate` (`recalibrateall` for a folder of them) and `batches`. `list` and `trust` keep track.
`twin.chain` lists all, with what each stage reads and writes.
"""
