"""The calibration problem of a project, and its runs that are still valid.

Read `workbench` first: a project becomes its calibration problem (`twin/calibrated`). `meshshapes` measures a
mesh. `fits` finds the runs that still belong to the project, and says what has changed since the others,
`effectlaws` the law of an effect that was kept, `waterfall` the error after each effect. `engines` finds the
program that twin.toml names to solve the model, `priors` reads priors and loss, `firstvibration` tells how
slowly the finger vibrates. `comparison` writes a judged
model and its errors into a run, with the provenance of the fit and its agreement with tests of the silicone.
`effectchange` refits the model with other effects; `filmedge` keeps how a fitted model moves the edge that
the review draws; `explorationranges` reads the ranges of `twin explore`; `modeldifferences` compares the
models of two projects.
"""
