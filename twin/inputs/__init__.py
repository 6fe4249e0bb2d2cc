"""What was recorded, as `vision` and the model take it.

Read `recordings` first: films with their cameras, markers and the log. `cameras` gives the lens of each
film, as a `camerarecord` holds it, `boardtimes` the clock of a board's film. `filmcheck` looks at films
within seconds, before anything is measured. `synchronisation` puts film and log on one clock. `pressure`
says what the log shows while the film runs. `filmtargets` makes targets of one film, `films` puts the
targets of several together, and `foreign` takes displacements that another program measured.
"""
