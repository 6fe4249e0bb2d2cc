"""A path of equilibria with derivatives.

Read in this order: `newton` finds one equilibrium, `corrected` is its tangent; `curve` follows a structure
without memory over pressure; `memory` follows one with memory along time (`past`: what it remembers).
`varied` holds derivatives to parameters, and names what they cannot be taken to; `adjoint` takes them to a
memory that the structure itself does not have. `loadings` handles gravity that turns; `reach` says why a path
ends.
"""
