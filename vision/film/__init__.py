"""Grey frames with the container's own time stamps, from a film file or a folder of pictures.

Read `video` first: one film, of which one frame at a time is in memory; `packets` tells how it was coded.
`series` takes a folder of pictures as a film, in the order that `numbering` reads in their names.
`checkpoint` goes through a film and keeps what every frame showed, so that a killed run follows no frame
twice; `decoding` reads ahead meanwhile. `picturefaults` says what is wrong with a picture: dark, blurred,
repeated. `flash` finds when a lamp in the film goes on. `scheduling` keeps an encoder from taking the whole
computer.
"""
