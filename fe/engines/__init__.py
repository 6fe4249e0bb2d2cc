"""Engines that solve a case: the built-in kernel, CalculiX, Abaqus.

Read `engine` first, the interface of all; `calculix` and `abaqus` are one program each, whose jobs `process`
runs. `writer` writes the Abaqus deck of a case, `obstacle` the rigid obstacle in it. `along` of `engine`
makes a solution of the displacements that a program returned.
"""
