"""The virtual laboratory: a protocol and a hidden truth -> displacements, pressure logs and noisy targets.

The truth lives on another mesh and another element than the model's, and may hold effects or laws that no
model has. Nothing that diagnoses may import this room. Read `protocols` (what is filmed), `hidden` (what is
missing), `sizing` (how plain it is), `truthsolves` (the finite-element solves of a truth), `draws` and
`filming` (noise and targets), in this order.
"""

from twin.virtual.filming import (
    FILM_A,
    LATTICE,
    Bench,
    Truth,
    at_nodes,
    displacements,
    noisy_targets,
    path,
)

__all__ = ["FILM_A", "LATTICE", "Bench", "Truth", "at_nodes", "displacements", "noisy_targets", "path"]
