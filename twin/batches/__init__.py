"""A series of batches: their order, what they can be compared by, and what is kept from one to the next.

`values` is what two batches can be compared by, each with its sd. `differences` asks what a finger differs in
from the model of a former one, `castings` says it of two projects. `former` is the batch before, whose rig a
new one may share; `series` the projects below a folder in their order, and the constants of a batch beside
those before it; `side` one of two recordings that `twin compare A B` lays side by side.
"""
