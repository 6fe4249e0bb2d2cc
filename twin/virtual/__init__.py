"""The virtual laboratory: a protocol and a hidden truth -> displacements, pressure logs and noisy targets.

The truth lives on another mesh than the model's, and may hold effects or laws that no model has. Nothing that
diagnoses may import this room. Read `protocols` (what is filmed), `hidden` (what is missing; `hiddenmotion`
has the inertia), `truthsolves` (the finite-element solves of a truth), `draws` (noise, targets, and how plain
a truth is in them), in this order.
"""

from twin.virtual.draws import at_nodes, noisy_targets
from twin.virtual.protocols import FILM_A, Bench, Corners, path
from twin.virtual.truthsolves import LATTICE, displaced, truth_case

__all__ = [
    "FILM_A", "LATTICE", "Bench", "Corners", "at_nodes", "displaced", "noisy_targets", "path", "truth_case",
]  # fmt: skip
