"""Laws of the silicone, the base material to which effects add: one file for each strain energy.

Read `law` first: a law is its constants with bounds, an energy in one line, and how a material, a stiffness
and a form are made of the constants. `reducedpolynomial` (neo-Hooke, Yeoh), `mooneyrivlin`, `ogden`, `gent`
and `arrudaboyce` hold the laws, `catalogue` lists them; `stability` says how far a rubber may be stretched
before it is none.
"""
