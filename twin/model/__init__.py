"""A test and effects become predicted displacements, with derivatives and with the error of the mesh.

Read `prediction` first: a model without any state. `keptmodel` keeps its solves and changes no answer;
`response` answers between them in milliseconds, and says how far off it may be, `rangedresponse` within a
range that a user states, and `nearmodel` near its solves, in place of more of them; `firstorder` adds markers
that slip, and what comes and goes by a course of its own; `sagged` finds the material point of a marker that
is known by where it is seen at rest. `keptmodel` also makes the base model of targets; `structure` says what
a model is made of: the built-in finger or a deck; `objects` what it may touch.
`discretisation` measures the error of its mesh on finer meshes, and of linear tetrahedra beside quadratic
ones; `meshchanges` takes their changes apart. `loadpaths` tabulates displacements over a law's constants for
the genetic algorithm. Both come with the package for the fingers of the demos (`fingertable`). `arraycache`
says what stored arrays are keyed by. `enginejobs` runs another program (Abaqus, CalculiX), `enginemodel` is a
model that it solves.
"""
