"""Natural vibrations about a loaded state, and motions in time.

Read `mass` first: the consistent mass, with masses at points. `loading` is an equilibrium under a held load,
with the tangent that a vibration feels there; `vibration` has frequencies, shapes and damping. `timesteps`
follows a motion along a path: each step is an equilibrium with inertia. `reduced` does so with a few
unknowns, checked by whole steps; `onevibration` with one, in closed form.
"""
