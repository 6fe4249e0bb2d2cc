"""The recordings of a project: cameras, films, pressure log, and targets made of them.

Read `recordings` first: films with their cameras, markers and the log. `foundrecordings` finds them in a
folder. `cameras` gives the lens of each film, as camera.json holds it, and the clock of a board's film.
`filmcheck` looks at films within seconds, before anything is measured. `synchronisation` puts film and log
on one clock. `filmsteps` tells how many frames of a film are kept. `filmtargets` makes targets of one film,
`films` puts the targets of several together, `elsewhere` those of other programs' recordings. `looseframe`
makes the frame of loose markers. `outlines` compares the outline of the model with that of the finger at
rest, sagged as `restsags` says; `outlinechecks` compares that of the fitted model with the film's at later
moments.
"""
