"""Arrays become pictures: plots, drawings of the finger, stills and clips of the film, sheets to print.

Read `theme` first: the look that all plots share. `plots` draws the report's, `studyplots` those of the
reference study, `driftchart` a quantity over batches. `blueprint` draws the finger with its dimensions,
`slicing` cuts its mesh, `meshpictures` shows nodes and element shapes, `undeformed` puts them into rerun.
`deformed` draws the mesh under pressure and writes files for ParaView. `outlines` finds the edge that a
camera sees; `painting` and `clip` draw models over film. `canvas` is paper at true scale.
"""
