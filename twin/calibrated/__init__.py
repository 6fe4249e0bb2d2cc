"""A calibration without a folder: its problem, and what a calibrated model is asked for.

`measurements` reads a table, `actuators` makes a body or a deck, and `calibration` fits, diagnoses, extends
and asks it: these are the names of `twin` itself; `reports` are what they return. Underneath read `problem`
first: targets, structure and law become a model on its mesh, fitted and judged; `caches` keeps solved finer
meshes, in a folder or in memory. `positions` are points on its surface, `effectstarts` begin the fit of an
effect more. `predictions` are displacements under pressures that nobody has filmed, `predictionerrors` what
is uncertain of them, `courseinertia` what inertia adds along a fast course; `inverse` is the pressure for a
wanted displacement, `blockedforce` the force of a finger whose end is held, `objectforce` the force on an
object that it meets, `naturalvibrations` its frequencies about held pressures. `profiles` are likelihood
profiles of parameters, `posterior` samples of all of them together, `tradeoff` what fits one part of the
targets at the cost of another, and `exploration` solves fingers of other dimensions.
"""
