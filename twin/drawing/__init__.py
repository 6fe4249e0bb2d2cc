"""Arrays become pictures: plots, drawings of the finger, stills and clips of the film, sheets to print.

Read `theme` first: the look that all plots share. `plots` draws the film's steps and errors, `studyplots`
the search and what it found, `predictionplot` what nobody has measured, `touchplot` how the finger presses on
an object, `curveplot` tests of the silicone. Of a fit, `profileplot` draws how well parameters are known,
`posteriorplot` how likely they are, `paretoplot` what fits of parts cost each other, `startsplot` where
several fits end. `exploreplots` draws a
design of experiments, `driftchart` a quantity over batches. `blueprint` draws the finger with its dimensions,
`meshpictures` nodes and element shapes, `readpicture` what a deck was read as. `deformed` draws the mesh
under pressure and writes files for ParaView. `outlines` finds the edge that a camera sees; `painting` and
`clip` draw models over film. `canvas` is paper at true scale.
"""
