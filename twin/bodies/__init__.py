"""The kinds of actuator that the program can mesh, one file a kind: dimensions, mesh, drawing, named places.

Read `body` first: what every kind offers. `finger` is the bellows finger, `pneunet` a row of chambers over a
channel, `tube` a tube with a chamber off its axis, `bar` a solid beam; `kinds` lists them. A user's own mesh
(an Abaqus deck) is none of them: see `twin.model.structure`.
"""
