"""A calibration without a folder: its problem, and what a calibrated model is asked for.

Read `problem` first: targets, structure and law become a model on its mesh, fitted and judged; `caches` keeps
solved finer meshes, in a folder or in memory. `predictions` are displacements under pressures that nobody has
filmed, `predictionerrors` what is uncertain of them; `inverse` is the pressure for a wanted displacement,
`blockedforce` the force of a finger whose end is held, `objectforce` the force on an object that it meets.
`profiles` are likelihood profiles of parameters, `posterior` samples of all of them together, `tradeoff` what
fits one part of the targets at the cost of another, and `exploration` solves fingers of other dimensions.
"""
