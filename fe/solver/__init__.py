"""Paths of equilibria and their derivatives with respect to parameters.

Read in this order: `newton` finds one equilibrium, `refinement` solves with its tangent; `curve` follows a
structure without memory over pressure; `memory` follows one with memory along time (`historyvariables`: its
internal variables). `sensitivity` differentiates with respect to parameters, and refuses what it cannot;
`adjoint` differentiates towards creep and softening from a base without memory. `loadings` handles changing
gravity; `limits` names the cause where a path ends.
"""
