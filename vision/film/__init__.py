"""A film file becomes grey frames with the container's own time stamps.

Read `video` first (one film, one frame in memory at a time), then `series` (a folder of pictures as a
film), `stutter` and `flash` (repeated pictures, a lamp that marks a moment), and `checkpoint`, which
keeps what every frame showed so that a killed run follows no frame twice.
"""
