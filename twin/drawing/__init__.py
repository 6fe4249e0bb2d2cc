"""Arrays become pictures: plots, drawings of the finger, stills and clips of the film, sheets to print.

Read `theme` first: the look that all plots share. `plots` draws displacements, residuals and errors,
`studyplots` the genetic algorithm and the figures of `twin study`, `touchplot` the finger on an object,
`vibrationplot` how it vibrates.
`fitplots` draws ends of several fits, tests of the silicone, a Pareto front, a design of experiments and a
quantity over batches, `uncertaintyplots` likelihood profiles, posteriors and predictions. `blueprint` draws
the finger with its dimensions, `meshpictures` nodes, element shapes and what a deck was read as. `deformed`
draws the mesh under pressure and writes files for ParaView. `painting` draws models over film, as a still or
a clip. `canvas` is paper at true scale, `framepaper` where the rig's markers go on it.
"""
