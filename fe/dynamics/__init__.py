"""Natural vibrations about a loaded state.

Read `mass` (consistent mass, with masses at points), `loading` (an equilibrium under a held load, with the
tangent that a vibration feels there) and `vibration` (frequencies, shapes, damping) in this order.
"""
