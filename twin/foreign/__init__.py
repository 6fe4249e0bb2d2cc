"""A model that is not of this program: a callable, diagnosed from outside.

Read `programs` first: somebody's program as a callable, checked at every answer, no run made twice;
`slowruns` tells how far it is.
`foreignmodel` is that program as the diagnosis asks every model, with `courseeffects`, the effects that need
no structure of ours: the pressure's course, clocks, the picture, creep and drift by what they do to the
pressure, and `likebody`, those inside a structure by their shape in our own model of a like body.
`foreigndiagnosis` puts them beside data, and `wantedruns` says what the program should be
able to have. `runtable` proposes runs that are made anywhere, and takes their table for a program.
"""
