"""Arrays become pictures: plots, drawings of the finger, stills and clips of the film, sheets to print.

Read `theme` first: the look that all plots share. `plots` draws displacements, residuals and errors,
`studyplots` the genetic algorithm and the figures of `twin study`, `touchplot` the finger on an object.
`fitplots` draws ends of several fits, tests of the silicone and a Pareto front, `uncertaintyplots` likelihood
profiles, posteriors and predictions, `exploreplots` a design of experiments, `driftchart` a quantity over
batches. `blueprint` draws the finger with its dimensions, `meshpictures` nodes and element shapes,
`readpicture` what a deck was read as. `deformed` draws the mesh under pressure and writes files for ParaView.
`outlines` finds the edge that a camera sees; `painting` and `clip` draw models over film. `canvas` is paper
at true scale.
"""
