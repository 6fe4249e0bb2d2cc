"""Natural vibrations about a loaded state, and motions in time.

Read `mass` (consistent mass, with masses at points), `loading` (an equilibrium under a held load, with the
tangent that a vibration feels there), `vibration` (frequencies, shapes, damping) and `timesteps` (a motion
along a path, by an equilibrium with inertia in each step) in this order.
"""
