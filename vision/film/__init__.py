"""Grey frames with the container's own time stamps, from a film file or a folder of pictures.

Read `video` first: one film, of which one frame at a time is in memory. `series` takes a folder of pictures
as a film. `stutter` finds repeated pictures, `flash` a lamp that marks a moment,
`sharpness` why a picture may show no marker. `checkpoint` goes through a
film and keeps what every frame showed, so that a killed run follows no frame twice.
"""
